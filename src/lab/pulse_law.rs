//! The pulse of the UPM paper's Figs. 8 and 9: wave, envelope and their product; a part's displacement against the
//! square of the pulse's length, and the limit of that law.

use std::f64::consts::TAU;

use super::pulses::{EDGE_M, check_carries, envelope, play, saturation, strongest_spin};
use super::sweep::Progress;
use super::texts::{chart, figure};
use super::{ExperimentResult, Figure, LabError, LabRig, coulomb_pump};
use upm_chart::{Chart, Color};
use upm_core::geometry::Vec2;
use upm_core::job::PlateMode;
use upm_core::signal::Envelope;
use upm_core::units::{GRAVITY_MPS2, mm_from_m};
use upm_sim::OpenPulse;

/// Most lengths of pulses; each is sustained for whole periods, since others end in mid-oscillation.
const LENGTHS: usize = 24;
/// Samples per period.
const SAMPLES: f64 = 64.0;
/// Belt speed of the fast plate over the speed that the longest pulse gives; the slow plate's is equal to that speed.
const FASTER: f64 = 8.0;
/// Periods for which the two pulses of Fig. 9 are sustained.
const PERIODS: [f64; 2] = [2.0, 6.0];
/// Rest after the pulse in which the part stops, s.
const REST_S: f64 = 0.25;
/// Deviation of displacement over S² from the largest above which a pulse is beyond the law.
const OFF: f64 = 0.1;
/// Integration steps per period of the averaged motion.
const FINE: f64 = 200.0;

/// A part in the middle of a plate that turns about one of its corners.
struct PivotSetup<'a> {
    rig: &'a LabRig,
    mode: PlateMode,
    cor_m: Vec2,
    spin_radps: f64,
}

/// A pulse and the resulting motion.
struct PlayedPulse {
    envelope: Envelope,
    t_s: Vec<f64>,
    /// Distance travelled at each instant, m.
    way_m: Vec<f64>,
    /// Displacement by the mean force, m.
    averaged_m: f64,
}

impl PlayedPulse {
    /// Attack and decay included: friction depends only on the direction of slip, so that they count nearly in full.
    fn length_s(&self) -> f64 {
        self.envelope.driven_s()
    }

    fn found_m(&self) -> f64 {
        self.way_m.last().copied().unwrap_or(f64::NAN)
    }

    fn over_square_mps2(&self, way_m: f64) -> f64 {
        way_m / self.length_s().powi(2)
    }
}

/// A pulse's waves, the speed of a part in a short one and in a longer one, and displacement against the square of the
/// length: on two ideal plates, with belts much faster than and as fast as the part after the longest pulse by that
/// law, and on the rig's own, driven within its motors' limits.
///
/// # Errors
///
/// A rig whose motors do not carry the part.
pub fn pulse_law(rig: &LabRig, _: Progress<'_>) -> Result<ExperimentResult, LabError> {
    let inset_m = 0.5 * rig.sim.plate.side_m - rig.penny.radius_m - EDGE_M;
    let cor_m = Vec2::new(-inset_m, -inset_m);
    let sustains_s = sustains_s(rig);
    let longest_s = envelope(rig, sustains_s.last().copied().unwrap_or(0.0)).driven_s();
    let gained_mps = coulomb_pump::mean_force(0.0) * rig.penny.friction * GRAVITY_MPS2 * longest_s;
    let exact = |faster: f64| PivotSetup {
        rig,
        mode: PlateMode::Kinematic,
        cor_m,
        spin_radps: faster * gained_mps / coulomb_pump::BELT / cor_m.norm(),
    };
    let own = PivotSetup { rig, mode: PlateMode::Dynamic, cor_m, spin_radps: strongest_spin(rig, cor_m)? };
    check_carries(rig, own.spin_radps, cor_m.norm())?;
    let benches = [(exact(FASTER), "fast plate"), (exact(1.0), "slow plate"), (own, "this rig")];
    let mut outcome = ExperimentResult::default();
    let [short, long] = PERIODS.map(|periods| benches[0].0.play(periods * TAU / rig.model.base_radps));
    let (short, long) = (short?, long?);
    outcome.charts = vec![wave_chart(rig, &short.envelope), speed_chart(&short, &long)];
    for (bench, name) in &benches {
        let rows = sustains_s.iter().map(|&sustain_s| bench.play(sustain_s)).collect::<Result<Vec<_>, _>>()?;
        outcome.figures.extend(figures(bench, &rows, name));
        outcome.charts.push(law_chart(bench, &rows, name));
    }
    Ok(outcome)
}

/// Sustains of whole periods up to the rig's longest, s, denser among the short ones.
fn sustains_s(rig: &LabRig) -> Vec<f64> {
    let period_s = TAU / rig.model.base_radps;
    let most = (rig.model.max_sustain_s / period_s + 1e-9).floor();
    let share = |i: usize| (i as f64 / (LENGTHS - 1) as f64).powi(2);
    let mut periods: Vec<f64> = (0..LENGTHS).map(|i| (share(i) * most).round()).collect();
    periods.dedup();
    periods.into_iter().map(|periods| periods * period_s).collect()
}

impl PivotSetup<'_> {
    fn play(&self, sustain_s: f64) -> Result<PlayedPulse, LabError> {
        let rig = self.rig;
        let envelope = Envelope { rest_s: REST_S, ..envelope(rig, sustain_s) };
        let pulse = OpenPulse::about(self.cor_m, self.spin_radps, envelope);
        let found = play(rig, self.mode, &[Vec2::zeros()], &[pulse], SAMPLES * rig.model.base_radps / TAU)?;
        let way_m = found.ways_m.iter().flatten().map(|at| at.norm()).collect();
        Ok(PlayedPulse { envelope, t_s: found.t_s, way_m, averaged_m: self.averaged_m(&envelope) })
    }

    /// Speed A of the plate under the part, m/s.
    fn amplitude_mps(&self) -> f64 {
        self.spin_radps.abs() * self.cor_m.norm()
    }

    /// Displacement over S², `½ f0 (1 + f0) μ g`: gained at the constant force on a part at rest, and coasted
    /// afterwards.
    fn law_mps2(&self) -> f64 {
        let at_rest = coulomb_pump::mean_force(0.0);
        0.5 * at_rest * (1.0 + at_rest) * self.rig.penny.friction * GRAVITY_MPS2
    }

    /// The same with the mean force at the part's current speed (Eq. 18), on a plate that follows its envelope.
    fn averaged_m(&self, envelope: &Envelope) -> f64 {
        let drag_mps2 = self.rig.penny.friction * GRAVITY_MPS2;
        let step_s = TAU / self.rig.model.base_radps / FINE;
        let (mut t_s, mut speed_mps, mut way_m) = (0.5 * step_s, 0.0f64, 0.0);
        while t_s < envelope.driven_s() || speed_mps > 0.0 {
            let plate_mps = self.amplitude_mps() * envelope.at(t_s);
            let force = if plate_mps > 0.0 { coulomb_pump::mean_force(speed_mps / plate_mps) } else { -1.0 };
            let next_mps = (speed_mps + force * drag_mps2 * step_s).max(0.0);
            way_m += 0.5 * (speed_mps + next_mps) * step_s;
            (speed_mps, t_s) = (next_mps, t_s + step_s);
        }
        way_m
    }
}

fn figures(bench: &PivotSetup<'_>, rows: &[PlayedPulse], plate: &str) -> [Figure; 7] {
    let averaged = |row: &PlayedPulse| row.over_square_mps2(row.averaged_m);
    let found = |row: &PlayedPulse| row.over_square_mps2(row.found_m());
    let gained = |row: &PlayedPulse| saturation(bench.rig, bench.spin_radps.abs(), bench.cor_m.norm(), &row.envelope);
    let largest = rows.iter().map(found).fold(0.0, f64::max);
    let within = || rows.iter().filter(|row| found(row) > (1.0 - OFF) * largest);
    let (from, to, last) = (within().next(), within().next_back(), rows.last());
    // the mean force of Eq. 18 knows the belt, but not where in a period a flank ends
    let belted = |row: &PlayedPulse| averaged(row) < (1.0 - OFF) * rows.iter().map(averaged).fold(0.0, f64::max);
    let ends = match rows.iter().find(|row| to.is_some_and(|to| row.length_s() > to.length_s())) {
        None => "the longest pulse",
        Some(next) if belted(next) => "beyond it the belt limits",
        Some(_) => "the largest is that of a pulse that is mostly flank",
    };
    let of = |row: Option<&PlayedPulse>, value: &dyn Fn(&PlayedPulse) -> f64| row.map_or(f64::NAN, value);
    let length_ms = |row: &PlayedPulse| 1e3 * row.length_s();

    let found_mm = |row: &PlayedPulse| mm_from_m(row.found_m());
    let law = format!("½ f0 (1 + f0) μ g is {:.4}; S with attack and decay", bench.law_mps2());
    let averaged_mm = of(last, &|row| mm_from_m(row.averaged_m));
    let integrated = format!("Eq. 18 integrated over the envelope: {averaged_mm:.2}");
    let figures = [
        figure("{}: speed A under the part", bench.amplitude_mps()),
        Figure::alone("{}: displacement over S², largest", "m/s²", largest, &law),
        figure("{}: within 10 % of that from S", of(from, &length_ms)),
        Figure::alone("{}: within 10 % of that up to S", "ms", of(to, &length_ms), ends),
        figure("{}: speed gained there, over A/2", of(to, &gained)),
        figure("{}: displacement there", of(to, &found_mm)),
        Figure::alone("{}: displacement by the longest pulse", "mm", of(last, &found_mm), &integrated),
    ];
    figures.map(|figure| figure.of(plate))
}

/// Chart of Fig. 8.
fn wave_chart(rig: &LabRig, envelope: &Envelope) -> Chart {
    let period_s = TAU / rig.model.base_radps;
    let count = (envelope.driven_s() / period_s * SAMPLES) as usize;
    let times = || (0..=count).map(|i| i as f64 * period_s / SAMPLES);
    let wave = |t_s: f64| {
        let phase_rad = TAU * t_s / period_s;
        phase_rad.cos() - 0.5 * (2.0 * phase_rad).cos()
    };
    let curve = |of: &dyn Fn(f64) -> f64| times().map(|t_s| [1e3 * t_s, of(t_s)]).collect::<Vec<_>>();
    chart("pulse-law-wave")
        .line("cos wt - ½ cos 2wt", Color::Gray, curve(&wave))
        .line("envelope", Color::Orange, curve(&|t_s| envelope.at(t_s)))
        .line("product", Color::Blue, curve(&|t_s| envelope.at(t_s) * wave(t_s)))
}

/// Chart of Fig. 9.
fn speed_chart(short: &PlayedPulse, long: &PlayedPulse) -> Chart {
    let samples = SAMPLES as usize;
    let mean = |played: &PlayedPulse| {
        let track = || played.t_s.iter().zip(&played.way_m);
        let pairs = track().zip(track().skip(samples));
        let speed = |((t0, way0), (t1, way1))| [1e3 * 0.5 * (t0 + t1), mm_from_m((way1 - way0) / (t1 - t0))];
        pairs.map(speed).collect::<Vec<_>>()
    };
    let label = |played: &PlayedPulse| format!("sustained for {:.0} ms", 1e3 * played.envelope.sustain_s);
    chart("pulse-law-speed").line(&label(short), Color::Blue, mean(short)).line(&label(long), Color::Orange, mean(long))
}

fn law_chart(bench: &PivotSetup<'_>, rows: &[PlayedPulse], plate: &str) -> Chart {
    let points = |way_m: &dyn Fn(&PlayedPulse) -> f64| -> Vec<[f64; 2]> {
        rows.iter().map(|row| [row.length_s().powi(2), mm_from_m(way_m(row))]).collect()
    };
    let (name, title) =
        (format!("pulse-law-{}", plate.replace(' ', "-")), format!("Displacement by one pulse, {plate}"));
    Chart::plot(name, title, ["S² (s²), attack and decay included", "displacement (mm)"])
        .dashes("law of squares", Color::Gray, points(&|row| bench.law_mps2() * row.length_s().powi(2)))
        .line("mean force (Eq. 18), integrated", Color::Blue, points(&|row| row.averaged_m))
        .dots("simulated", Color::Orange, points(&PlayedPulse::found_m))
}

#[cfg(test)]
mod tests {
    use super::super::testing::{assert_sources_are_short, curve, lab_rig};
    use super::*;

    #[test]
    fn displacement_follows_the_square_where_the_belt_is_fast_and_the_mean_force_elsewhere() {
        for name in ["upm-1", "upm-2"] {
            let outcome = pulse_law(&lab_rig(name), &|_| ()).unwrap();
            assert_sources_are_short(&outcome);
            let figure = |start: &str| outcome.figures.iter().find(|figure| figure.name.starts_with(start)).unwrap();
            let fast = figure("fast plate: displacement over S²");
            assert!((fast.measured / 0.4346 - 1.0).abs() < 0.1, "{name}: {fast:?}");
            let whole =
                [figure("fast plate: within 10 % of that from"), figure("fast plate: within 10 % of that up to")];
            let found = curve(&outcome, "pulse-law-fast-plate", "simulated");
            for (figure, end) in whole.iter().zip([found.first(), found.last()]) {
                assert!((figure.measured - 1e3 * end.unwrap()[0].sqrt()).abs() < 1e-6, "{name}: {figure:?}");
            }
            let slow = figure("slow plate: displacement over S²").measured;
            assert!(slow < 0.85 * fast.measured, "{name}: the belt limits: {slow}");
            for plate in ["fast", "slow"] {
                let [longest, averaged] = ["simulated", "mean force (Eq. 18), integrated"]
                    .map(|label| curve(&outcome, &format!("pulse-law-{plate}-plate"), label).last().unwrap()[1]);
                assert!((longest / averaged - 1.0).abs() < 0.05, "{name}: {longest} {averaged}");
            }
        }
    }

    #[test]
    fn belt_is_named_only_where_it_limits() {
        let ends = |rig: &LabRig, plate: &str| {
            let name = format!("{plate}: within 10 % of that up to S");
            let outcome = pulse_law(rig, &|_| ()).unwrap();
            outcome.figures.iter().find(|figure| figure.name == name).unwrap().source.clone()
        };
        let mut rig = lab_rig("upm-2");
        assert_eq!(ends(&rig, "fast plate"), "the longest pulse");
        (rig.penny.friction, rig.model.base_radps) = (0.45, TAU * 45.0);
        assert!(ends(&rig, "fast plate").contains("mostly flank"));
        assert!(ends(&lab_rig("upm-1"), "this rig").contains("the belt limits"));
    }
}
