use super::clearance::check_apart;
use super::placement::PlacedPart;
use super::raw_simulate::{RawHarmonic, RawPulse, RawSimulate};
use super::read::{Origin, point_m};
use super::rig::RigSpec;
use upm_core::geometry::Twist;
use upm_core::job::PlateMode;
use upm_core::signal::{Envelope, TwistHarmonic};
use upm_core::units::mm_from_m;
use upm_document::{Diagnostic, Diagnostics, Path, parse_and_build, text_of};
use upm_sim::OpenPulse;

/// Most samples in the output, over all parts.
const MOST_SAMPLES: f64 = 1e7;

/// Steps of the simulation and samples of the waveform generator per period of the highest harmonic; a rig's two
/// harmonics must meet the same limits.
const STEPS_A_PERIOD: f64 = 50.0;
const SAMPLES_A_PERIOD: f64 = 4.0;

/// Validated open-loop experiment.
#[derive(Clone, Debug, PartialEq)]
pub struct SimulateSpec {
    /// Rig with the parameters of the simulation.
    pub rig: RigSpec,
    /// Motion of the plate: driven by its motors, or prescribed.
    pub plate: PlateMode,
    /// Base frequency of every pulse, rad/s.
    pub base_radps: f64,
    /// Parts at their start, with the friction of their kind.
    pub parts: Vec<PlacedPart>,
    /// Pulses, one after another.
    pub pulses: Vec<OpenPulse>,
    /// Output sampling rate, Hz.
    pub sample_hz: f64,
}

impl SimulateSpec {
    /// Reads and validates the experiment file at `path` and the rig it names. Errors list every fault.
    pub fn load(path: &std::path::Path) -> Result<Self, Vec<Diagnostic>> {
        let text = text_of(path).map_err(|fault| vec![fault])?;
        Self::from_json(&text, &Origin::of_file(path))
    }

    /// Validates the experiment in `text`. Errors list every fault.
    pub fn from_json(text: &str, origin: &Origin) -> Result<Self, Vec<Diagnostic>> {
        parse_and_build(text, &origin.file, |raw, faults| Self::build(raw, origin, faults))
    }

    fn build(raw: RawSimulate, origin: &Origin, faults: &mut Diagnostics) -> Option<Self> {
        let root = Path::root();
        for (i, pulse) in raw.pulses.iter().enumerate() {
            check_pulse(pulse, &root.key("pulses").index(i), faults);
        }
        let rig = RigSpec::from_source(raw.rig.clone(), origin, &root.key("rig"), faults)?;
        let base_hz = raw.base_hz.unwrap_or(rig.raw.drive.base_hz);
        check_frequencies(&raw, &rig, base_hz, faults);
        let parts = placed(&raw, &rig, faults);
        let pulses: Vec<OpenPulse> = raw.pulses.iter().filter_map(|pulse| pulse_of(pulse, &rig)).collect();
        let total_s: f64 = pulses.iter().map(|pulse| pulse.envelope.total_s()).sum();
        let samples = total_s * raw.sample_hz * raw.parts.len() as f64;
        let found = format!("{samples:.0} samples of all parts over {total_s:.3} s");
        faults.require(samples <= MOST_SAMPLES, root.key("sample_hz"), found, format!("up to {MOST_SAMPLES:.0}"));
        let base_radps = std::f64::consts::TAU * base_hz;
        Some(Self { rig, plate: raw.plate, base_radps, parts, pulses, sample_hz: raw.sample_hz })
    }
}

/// The pulse in SI, with its sign; `None` if it has no motion.
fn pulse_of(raw: &RawPulse, rig: &RigSpec) -> Option<OpenPulse> {
    let sign = f64::from(raw.rotation);
    let harmonics = match &raw.harmonics {
        Some(harmonics) => harmonics.iter().map(|harmonic| harmonic.scaled(sign)).collect(),
        None => TwistHarmonic::pump(pump_of(raw)? * sign).to_vec(),
    };
    let envelope = Envelope {
        attack_s: raw.attack_s.unwrap_or(rig.model.attack_s),
        sustain_s: raw.sustain_s,
        rest_s: raw.rest_s.unwrap_or(rig.model.rest_s),
    };
    Some(OpenPulse { harmonics, envelope })
}

impl RawHarmonic {
    fn scaled(&self, scale: f64) -> TwistHarmonic {
        let twist = |[vx_mps, vy_mps, spin_radps]: [f64; 3]| Twist::new(vx_mps, vy_mps, spin_radps) * scale;
        TwistHarmonic { cos: twist(self.cos), sin: twist(self.sin) }
    }

    fn is_zero(&self) -> bool {
        self.cos == [0.0; 3] && self.sin == [0.0; 3]
    }
}

/// Velocity field of a rotation or a translation.
fn pump_of(raw: &RawPulse) -> Option<Twist> {
    match (raw.cor_mm, raw.omega_rad_s, raw.direction_deg, raw.speed_mps) {
        (Some(cor_mm), Some(omega_radps), ..) => Some(Twist::about(point_m(cor_mm), omega_radps)),
        (.., Some(direction_deg), Some(speed_mps)) => {
            let (sin, cos) = direction_deg.to_radians().sin_cos();
            Some(Twist::new(speed_mps * cos, speed_mps * sin, 0.0))
        }
        _ => None,
    }
}

fn check_pulse(raw: &RawPulse, at: &Path, faults: &mut Diagnostics) {
    let given = [
        raw.cor_mm.is_some(),
        raw.omega_rad_s.is_some(),
        raw.direction_deg.is_some(),
        raw.speed_mps.is_some(),
        raw.harmonics.is_some(),
    ];
    let motions =
        [[true, true, false, false, false], [false, false, true, true, false], [false, false, false, false, true]];
    if !motions.contains(&given) {
        let names = ["cor_mm", "omega_rad_s", "direction_deg", "speed_mps", "harmonics"];
        let found: Vec<&str> = names.into_iter().zip(given).filter_map(|(name, given)| given.then_some(name)).collect();
        let found = if found.is_empty() { "none of them".to_owned() } else { found.join(", ") };
        faults.push(at, found, "cor_mm and omega_rad_s, or direction_deg and speed_mps, or harmonics");
    }
    if let Some(harmonics) = &raw.harmonics {
        let moves = harmonics.iter().any(|harmonic| !harmonic.is_zero());
        faults.require(moves, at.key("harmonics"), "no motion", "an amplitude other than 0");
    }
}

/// Reports a harmonic too fast for the simulation's step or, if played by motors, for the generator, and a base
/// frequency so low that the velocity is not the integral of the force.
fn check_frequencies(raw: &RawSimulate, rig: &RigSpec, base_hz: f64, faults: &mut Diagnostics) {
    let (highest_hz, why) = highest_hz(rig, raw.plate);
    let mut check = |harmonic: usize, at: &Path| {
        let found_hz = harmonic as f64 * base_hz;
        let (found, allowed) =
            (format!("harmonic {harmonic} at {found_hz} Hz"), format!("up to {highest_hz:.1} Hz ({why})"));
        faults.require(found_hz <= highest_hz * (1.0 + 1e-9), at, found, allowed);
    };
    let root = Path::root();
    if raw.pulses.iter().any(|pulse| pulse.harmonics.is_none()) {
        check(2, &root.key("base_hz"));
    }
    for (i, pulse) in raw.pulses.iter().enumerate() {
        let harmonics = pulse.harmonics.as_deref().unwrap_or_default();
        if let Some(last) = harmonics.iter().rposition(|harmonic| !harmonic.is_zero()) {
            check(last + 1, &root.key("pulses").index(i).key("harmonics"));
        }
    }
    let resonance_hz = rig.sim.plate.resonance_hz.into_iter().fold(0.0, f64::max);
    let allowed = format!("above {resonance_hz}, the rig's highest resonance (velocity is the force's integral there)");
    let above = raw.plate == PlateMode::Kinematic || base_hz > resonance_hz;
    faults.require(above, root.key("base_hz"), base_hz, allowed);
}

/// Highest frequency that can be simulated, Hz, and the limit behind it.
fn highest_hz(rig: &RigSpec, plate: PlateMode) -> (f64, String) {
    let (step_s, motors) = (rig.sim.step_s, &rig.sim.motors);
    let step = (1.0 / (STEPS_A_PERIOD * step_s), format!("{STEPS_A_PERIOD} steps of {step_s} s a period"));
    let samples = format!("{SAMPLES_A_PERIOD} samples of the waveform generator a period");
    let generator = (motors.sample_hz / SAMPLES_A_PERIOD, samples);
    let low_pass = (motors.low_pass_hz, "the low-pass behind the waveform generator".to_owned());
    let lower = |a: (f64, String), b: (f64, String)| if b.0 < a.0 { b } else { a };
    match plate {
        PlateMode::Kinematic => step,
        PlateMode::Dynamic => lower(lower(step, generator), low_pass),
    }
}

fn placed(raw: &RawSimulate, rig: &RigSpec, faults: &mut Diagnostics) -> Vec<PlacedPart> {
    let half_m = 0.5 * rig.model.plate_side_m;
    let mut numbers = vec![0_usize; rig.kinds.len()];
    let (mut parts, mut discs) = (Vec::new(), Vec::new());
    for (i, part) in raw.parts.iter().enumerate() {
        let at = Path::root().key("parts").index(i);
        let Some(kind) = rig.known_kind(&part.kind, &at.key("kind"), faults) else { continue };
        let (Some(spec), Some(number)) = (rig.kinds.get(kind), numbers.get_mut(kind)) else { continue };
        *number += 1;
        let (position_m, radius_m) = (point_m(part.position_mm), spec.kind.radius_m);
        let at = at.key("position_mm");
        for (k, found) in part.position_mm.into_iter().enumerate() {
            let most_mm = mm_from_m(half_m);
            let allowed = format!("from -{most_mm} to {most_mm} (its centre on the plate)");
            faults.require(found.abs() <= most_mm, at.index(k), found, allowed);
        }
        discs.push((position_m, radius_m, at));
        let id = format!("{}-{number}", part.kind);
        parts.push(PlacedPart { kind, id, position_m, params: spec.part() });
    }
    check_apart(&discs, 0.0, faults);
    parts
}
