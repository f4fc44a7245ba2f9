//! Files of open-loop experiments: given pulses on given parts.

use std::f64::consts::TAU;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::clearance::check_apart;
use super::placement::PlacedPart;
use super::read::{Origin, given, optional_mm_point};
use super::rig::RigSpec;
use super::rig_file::RigSource;
use upm_core::document::{Diagnostic, Diagnostics, Path, parse_and_build, text_of};
use upm_core::geometry::{Twist, Vec2};
use upm_core::job::PlateMode;
use upm_core::signal::{Envelope, TwistHarmonic};
use upm_core::units::{file_form, mm_from_m, mm_point, whole, written_degrees, written_hertz, written_mm};
use upm_sim::OpenPulse;

/// An open-loop experiment: given pulses on given parts.
#[derive(Deserialize, JsonSchema)]
#[schemars(title = "simulate")]
pub(super) struct ExperimentFile {
    /// The rig: a path relative to this file, or the object itself.
    rig: RigSource,
    /// How the plate moves.
    #[serde(default)]
    plate: PlateMode,
    /// Base frequency w of every pulse, Hz. Left out: the rig's.
    #[serde(rename = "base_hz", default, with = "optional_hertz")]
    #[schemars(with = "Option<f64>", skip_serializing_if = "Option::is_none", range(min = 1.0, max = 1000.0))]
    base_radps: Option<f64>,
    /// Parts on the plate.
    #[schemars(length(min = 1, max = 64))]
    parts: Vec<PartEntry>,
    /// Pulses, one after another.
    #[schemars(length(min = 1, max = 1000))]
    pulses: Vec<PulseEntry>,
    /// Samples a second of the trajectories put out.
    #[serde(default = "whole::<f64, 1000>")]
    #[schemars(range(min = 1.0, max = 100_000.0))]
    sample_hz: f64,
}

file_form!(optional_hertz: Option<f64> => Option<f64>, |hz| hz.map(|hz| TAU * hz), |radps| radps.map(written_hertz));
file_form!(optional_degrees: Option<f64> => Option<f64>, |deg| deg.map(f64::to_radians),
    |rad| rad.map(written_degrees));

/// A part and where it starts.
#[derive(Deserialize, JsonSchema)]
struct PartEntry {
    /// penny, nickel, dime, quarter or a kind of the rig's.
    kind: String,
    /// Where it starts, mm; its centre lies on the plate.
    #[serde(rename = "position_mm", with = "mm_point")]
    #[schemars(with = "[f64; 2]", inner(range(min = -1000.0, max = 1000.0)))]
    position_m: Vec2,
}

/// A pulse: a rotation (`cor_mm`, `omega_rad_s`) or a translation (`direction_deg`, `speed_mps`), both with the wave
/// `cos wt - ½ cos 2wt`; or any periodic motion of the plate (`harmonics`).
#[derive(Serialize, Deserialize, JsonSchema)]
struct PulseEntry {
    /// Centre of rotation, mm.
    #[serde(rename = "cor_mm", default, with = "optional_mm_point")]
    #[schemars(with = "Option<[f64; 2]>", skip_serializing_if = "Option::is_none", inner(range(min = -1e6, max = 1e6)))]
    cor_m: Option<Vec2>,
    /// Amplitude of the spin, rad/s.
    #[schemars(range(max = 1000.0), extend("exclusiveMinimum" = 0.0))]
    omega_rad_s: Option<f64>,
    /// Direction of a translation, degrees counter-clockwise from x.
    #[serde(rename = "direction_deg", default, with = "optional_degrees")]
    #[schemars(with = "Option<f64>", skip_serializing_if = "Option::is_none", range(min = -360.0, max = 360.0))]
    direction_rad: Option<f64>,
    /// Amplitude of a translation's speed, m/s.
    #[schemars(range(max = 100.0), extend("exclusiveMinimum" = 0.0))]
    speed_mps: Option<f64>,
    /// The plate's velocity at full height: harmonic k of the base frequency at index k - 1.
    #[schemars(length(min = 1, max = 16))]
    harmonics: Option<Vec<HarmonicEntry>>,
    /// 1 as said, parts of a rotation flow counter-clockwise; -1 in reverse.
    #[serde(default = "whole::<i32, 1>")]
    #[schemars(extend("enum" = [-1, 1]))]
    rotation: i32,
    /// Length at full height, s.
    #[schemars(range(min = 0.0, max = 60.0))]
    sustain_s: f64,
    /// Attack and decay, s. Left out: the rig's.
    #[schemars(range(min = 0.0, max = 10.0))]
    attack_s: Option<f64>,
    /// Rest after it, s. Left out: the rig's.
    #[schemars(range(min = 0.0, max = 60.0))]
    rest_s: Option<f64>,
}

/// One harmonic of the plate's velocity: `cos` and `sin` times `cos kwt` and `sin kwt`. Each is the velocity of the
/// plate's centre along x and y, m/s, and its spin, rad/s, counter-clockwise.
#[derive(Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
struct HarmonicEntry {
    /// Amplitudes of `cos kwt`: m/s, m/s, rad/s.
    #[schemars(inner(range(min = -1000.0, max = 1000.0)))]
    cos: [f64; 3],
    /// Amplitudes of `sin kwt`: m/s, m/s, rad/s.
    #[schemars(inner(range(min = -1000.0, max = 1000.0)))]
    sin: [f64; 3],
}

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
        Self::from_json(&text_of(path)?, &Origin::of_file(path))
    }

    /// Validates the experiment in `text`. Errors list every fault.
    pub fn from_json(text: &str, origin: &Origin) -> Result<Self, Vec<Diagnostic>> {
        parse_and_build(text, &origin.file, |file, faults| Self::build(file, origin, faults))
    }

    fn build(file: ExperimentFile, origin: &Origin, faults: &mut Diagnostics) -> Option<Self> {
        let (root, pulses) = (Path::root(), file.pulses.iter().enumerate());
        let motions: Vec<_> =
            pulses.map(|(i, pulse)| pulse.motion(&root.key("pulses").index(i), faults).unwrap_or_default()).collect();
        let rig = RigSpec::from_source(file.rig.clone(), origin, &root.key("rig"), faults)?;
        let base_radps = file.base_radps.unwrap_or(rig.document.drive.base_radps);
        check_frequencies(&file, &rig, written_hertz(base_radps), faults);
        let parts = placed(&file, &rig, faults);
        let pulse_of = |(pulse, harmonics): (&PulseEntry, _)| OpenPulse {
            harmonics,
            envelope: Envelope {
                attack_s: pulse.attack_s.unwrap_or(rig.model.attack_s),
                sustain_s: pulse.sustain_s,
                rest_s: pulse.rest_s.unwrap_or(rig.model.rest_s),
            },
        };
        let pulses: Vec<OpenPulse> = file.pulses.iter().zip(motions).map(pulse_of).collect();
        let total_s: f64 = pulses.iter().map(|pulse| pulse.envelope.total_s()).sum();
        let samples = total_s * file.sample_hz * file.parts.len() as f64;
        let found = format!("{samples:.0} samples of all parts over {total_s:.3} s");
        faults.require(samples <= MOST_SAMPLES, root.key("sample_hz"), found, format!("up to {MOST_SAMPLES:.0}"));
        Some(Self { rig, plate: file.plate, base_radps, parts, pulses, sample_hz: file.sample_hz })
    }
}

impl HarmonicEntry {
    fn scaled(&self, scale: f64) -> TwistHarmonic {
        let twist = |[vx_mps, vy_mps, spin_radps]: [f64; 3]| Twist::new(vx_mps, vy_mps, spin_radps) * scale;
        TwistHarmonic { cos: twist(self.cos), sin: twist(self.sin) }
    }
}

impl PulseEntry {
    /// Harmonics of the plate's velocity, with their sign; a fault if not exactly one motion is given.
    fn motion(&self, at: &Path, faults: &mut Diagnostics) -> Option<Vec<TwistHarmonic>> {
        let Self { cor_m, omega_rad_s, direction_rad, speed_mps, harmonics, .. } = self;
        let sign = f64::from(self.rotation);
        let pump = match (*cor_m, *omega_rad_s, *direction_rad, *speed_mps, harmonics) {
            (Some(cor_m), Some(omega_radps), None, None, None) => Twist::about(cor_m, omega_radps),
            (None, None, Some(direction_rad), Some(speed_mps), None) => {
                let (sin, cos) = libm::sincos(direction_rad);
                Twist::new(speed_mps * cos, speed_mps * sin, 0.0)
            }
            (None, None, None, None, Some(harmonics)) => {
                let moves = harmonics.iter().any(|harmonic| *harmonic != HarmonicEntry::default());
                faults.require(moves, at.key("harmonics"), "no motion", "an amplitude other than 0");
                return Some(harmonics.iter().map(|harmonic| harmonic.scaled(sign)).collect());
            }
            _ => {
                let found = given(self, &["cor_mm", "omega_rad_s", "direction_deg", "speed_mps", "harmonics"]);
                let found = if found.is_empty() { "none of them".to_owned() } else { found.join(", ") };
                faults.push(at, found, "cor_mm and omega_rad_s, or direction_deg and speed_mps, or harmonics");
                return None;
            }
        };
        Some(TwistHarmonic::pump(pump * sign).to_vec())
    }
}

/// Reports a harmonic too fast for the simulation's step or, if played by motors, for the generator, and a base
/// frequency so low that the velocity is not the integral of the force.
fn check_frequencies(file: &ExperimentFile, rig: &RigSpec, base_hz: f64, faults: &mut Diagnostics) {
    let (highest_hz, why) = highest_hz(rig, file.plate);
    let mut check = |harmonic: usize, at: &Path| {
        let found_hz = harmonic as f64 * base_hz;
        let (found, allowed) =
            (format!("harmonic {harmonic} at {found_hz} Hz"), format!("up to {highest_hz:.1} Hz ({why})"));
        faults.require(found_hz <= highest_hz * (1.0 + 1e-9), at, found, allowed);
    };
    let root = Path::root();
    if file.pulses.iter().any(|pulse| pulse.harmonics.is_none()) {
        check(2, &root.key("base_hz"));
    }
    for (i, pulse) in file.pulses.iter().enumerate() {
        let harmonics = pulse.harmonics.as_deref().unwrap_or_default();
        if let Some(last) = harmonics.iter().rposition(|harmonic| *harmonic != HarmonicEntry::default()) {
            check(last + 1, &root.key("pulses").index(i).key("harmonics"));
        }
    }
    let resonance_hz = rig.sim.plate.resonance_hz.into_iter().fold(0.0, f64::max);
    let allowed = format!("above {resonance_hz}, the rig's highest resonance (velocity is the force's integral there)");
    let above = file.plate == PlateMode::Kinematic || base_hz > resonance_hz;
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

fn placed(file: &ExperimentFile, rig: &RigSpec, faults: &mut Diagnostics) -> Vec<PlacedPart> {
    let half_m = 0.5 * rig.model.plate_side_m;
    let mut numbers = vec![0_usize; rig.kinds.len()];
    let (mut parts, mut discs) = (Vec::new(), Vec::new());
    for (i, part) in file.parts.iter().enumerate() {
        let at = Path::root().key("parts").index(i);
        let Some(kind) = rig.known_kind(&part.kind, &at.key("kind"), faults) else { continue };
        let (Some(spec), Some(number)) = (rig.kinds.get(kind), numbers.get_mut(kind)) else { continue };
        *number += 1;
        let (position_m, radius_m) = (part.position_m, spec.kind.radius_m);
        let at = at.key("position_mm");
        for (k, found) in position_m.iter().map(|m| written_mm(*m)).enumerate() {
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
