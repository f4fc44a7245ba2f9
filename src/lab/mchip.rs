//! The M-Chip (Reznik, Brown, Canny, "Dynamic simulation as a design tool for a microactuator array", and section II of
//! the Impulse paper): an array of torsional resonators that moves a small flat part, simulated impact by impact.

mod batch;
mod belt;
mod bounce;
mod contact;
mod device;
mod drive;
mod impact;
mod measures;
mod part;
mod published;
mod resonator;
mod run;
mod sweeps;

use self::batch::{Batch, BatchJob, Summary, jams, mean, of_cluster};
use self::device::Device;
use self::drive::ResonatorDrive;
use self::measures::{arrivals, samples_from, spectrum};
pub use self::published::reproduce;
use self::run::Run;
use super::settings::{Field, Setting, settings};
use super::sweep::Progress;
use super::texts::{chart, figures};
use super::{ExperimentResult, Figure, LabError};
use upm_chart::{Chart, Color};
use upm_core::random::Streams;
use upm_core::units::mm_from_m;

/// Stalls longer than this are jams, s.
const JAM_S: f64 = 0.1;
/// One dyne, N.
const DYN_N: f64 = 1e-5;
/// Highest frequency of the spectrum that is drawn, Hz.
const DRAWN_HZ: f64 = 6_000.0;
/// Most points of a track that are drawn.
const DRAWN: usize = 4_000;

/// An array, its drive, its part, and the number and length of the runs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MChip {
    job: BatchJob,
    starts: u32,
    seed: u32,
}

/// Parameters of the array and its part.
pub const SETTINGS: &[Setting<MChip>] = settings! {
    "duty", [0.1, 0.9], 1.0, job.setup.drive.duty, "share of a cycle in which the torque is on";
    "strobe", [0.0, 1.0], count, job.setup.drive.strobe, "1: rows are off in turn, the wave of them running against the feed; 0: every row alike";
    "lambda", [2.0, 8.0], count, job.setup.drive.spacing, "rows from one that is off to the next";
    "gamma", [1.0, 10_000.0], count, job.setup.drive.cycles, "cycles for which a row is off";
    "row_delay", [0.0, 1.0], 1.0, job.setup.drive.row_delay, "delay of a row against the one before it, in cycles";
    "mass_ug", [10.0, 1_000.0], 1e-9, job.setup.part.mass_kg, "mass of the part; a lighter one is thrown higher than the array is long";
    "ridge_um", [-140.0, -20.0], 1e-6, job.setup.device.ridge_place_m, "place of the ridge from the axis, negative on the trailing side";
    "ridge_height_um", [2.0, 50.0], 1e-6, job.setup.device.ridge_height_m, "height of the ridge above its slab";
    "rim_um", [0.1, 2.0], 1e-6, job.setup.device.rim_radius_m, "radius of the ridge's rim";
    "drive_hz", [200.0, 20_000.0], 1.0, job.setup.device.drive_hz, "frequency of the torque";
    "peak_rad", [0.005, 0.2], 1.0, job.setup.device.peak_rad, "largest angle of a free resonator at 50 % duty";
    "natural_hz", [500.0, 50_000.0], 1.0, job.setup.device.natural_hz, "undamped natural frequency of a resonator";
    "damping", [0.05, 3.0], 1.0, job.setup.device.damping_ratio, "damping of a resonator over critical damping";
    "solidity", [0.1, 1.0], 1.0, job.setup.device.solidity, "mass of a slab over that of solid silicon";
    "friction", [0.0, 2.0], 1.0, job.setup.device.friction, "Coulomb friction of an impact";
    "restitution", [0.0, 0.95], 1.0, job.setup.device.restitution, "restitution of an impact";
    "force_dyn", [-1.0, 1.0], DYN_N, job.force_n, "force on the part along the feed";
    "step_us", [0.1, 2.0], 1e-6, job.setup.step_s, "step of the simulation";
    "time_s", [0.1, 20.0], 1.0, job.until_s, "length of a run";
    "starts", [1.0, 1_000.0], count, starts, "runs from different starts";
    "seed", [0.0, 1e9], count, seed, "seed of the starts";
};

impl MChip {
    /// The paper's array and part, with every row driven alike.
    pub fn published() -> Self {
        Self { job: BatchJob::published(ResonatorDrive::plain(), 0.2), starts: 4, seed: 1 }
    }
}

/// Rate, jams, impacts, energies and height of one array.
///
/// # Errors
/// A rim that does not fit its ridge.
pub fn measure(chip: &MChip, progress: Progress<'_>) -> Result<ExperimentResult, LabError> {
    let &MChip { job, starts, seed } = chip;
    let Device { ridge_height_m, rim_radius_m, .. } = job.setup.device;
    if rim_radius_m > 0.5 * ridge_height_m {
        let [most, found] = [0.5 * ridge_height_m, rim_radius_m].map(|radius_m| 1e6 * radius_m);
        let expected = format!("expected at most {most:.3} (half of the ridge's height)");
        return Err(LabError::Setting(format!("rim_um: {expected}, found {found}")));
    }
    let streams = Streams::new(seed.into());
    let mut batch = Batch::default();
    batch.add("", starts.into(), job);
    let summaries = batch.summaries(&streams, &|share| progress(0.9 * share));
    let (run, summaries) = (job.run(&streams), summaries.of(""));
    let left = summaries.iter().filter(|summary| !summary.stays).count();
    let note = || format!("the part left the array in {left} of {} runs, which end there", summaries.len());
    let notes = (left > 0).then(note).into_iter().collect();
    let charts =
        vec![track_chart("mchip-track", &[("feed", &run)]), gap_chart("mchip-collisions", &run), spectrum_chart(&run)];
    progress(1.0);
    Ok(ExperimentResult { figures: figures_of(summaries).into(), notes, charts, ..ExperimentResult::default() })
}

fn figures_of(summaries: &[Summary]) -> [Figure; 12] {
    let angular = |i: usize| mean(summaries, |summary| summary.energies.each[i].mean);
    figures([
        ("feed rate", mm_from_m(mean(summaries, |summary| summary.rate_mps))),
        ("feed rate while it moves", mm_from_m(mean(summaries, |summary| summary.feed.moving_mps))),
        ("starts that jam", jams(summaries, JAM_S)),
        ("longest stall", 1e3 * mean(summaries, |summary| summary.feed.longest_stall_s)),
        ("double bounces, of all contacts", mean(summaries, |summary| summary.clusters[0].share)),
        ("time since the contact before, double bounces", 1e3 * of_cluster(summaries, 0, |of| of.gap_s)),
        ("contacts once a cycle, of all", mean(summaries, |summary| summary.clusters[2].share)),
        ("angle of a resonator at a contact", mean(summaries, |summary| summary.angle_rad)),
        ("its angular speed", mean(summaries, |summary| summary.speed_radps)),
        ("energy of roll over that of pitch (AngX over AngY)", angular(3) / angular(4)),
        ("height of the part above rest", 1e6 * mean(summaries, |summary| summary.height_m.mean)),
        ("strongest line of the height", mean(summaries, |summary| summary.bounce_line[0])),
    ])
    .map(|figure| figure.of(&summaries.len().to_string()))
}

/// Displacement of the part over time.
fn track_chart(name: &str, runs: &[(&str, &Run)]) -> Chart {
    runs.iter().enumerate().fold(chart(name), |chart, (i, (label, run))| {
        let start_m = run.samples.first().map_or(0.0, |sample| sample.state.center_m.x);
        let stride = run.samples.len().div_ceil(DRAWN).max(1);
        let samples = run.samples.iter().step_by(stride);
        let track = samples.map(|sample| [sample.at_s, mm_from_m(sample.state.center_m.x - start_m)]);
        chart.line(label, Color::nth(i), track)
    })
}

/// Angle of the resonator over the time since the previous contact, contacts that push forwards and backwards
/// separately.
fn gap_chart(name: &str, run: &Run) -> Chart {
    let found = arrivals(&run.impacts, batch::SETTLED_S, f64::INFINITY);
    let points = |backward: bool| {
        let those = found.iter().filter(move |one| (one.forward_ns < 0.0) == backward && one.gap_s < 0.3e-3);
        those.map(|one| [1e3 * one.gap_s, one.angle_rad]).take(DRAWN).collect::<Vec<_>>()
    };
    let forward = chart(name).dots("pushes forward", Color::Blue, points(false));
    forward.dots("pushes backward", Color::Orange, points(true))
}

fn spectrum_chart(run: &Run) -> Chart {
    let samples = samples_from(run, batch::SETTLED_S);
    let heights_um: Vec<f64> = samples.iter().map(|sample| 1e6 * run.height_m(&sample.state)).collect();
    let lines = spectrum(&heights_um, run.setup.sample_s);
    let drawn = lines.into_iter().skip(1).take_while(|line| line[0] < DRAWN_HZ);
    chart("mchip-spectrum").line("height", Color::Blue, drawn)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::{assigned, assignment};

    fn set(text: &str) -> Result<ExperimentResult, LabError> {
        let assignments: Vec<_> = text.split_whitespace().map(|one| assignment(one).unwrap()).collect();
        measure(&assigned(SETTINGS, &MChip::published(), &assignments)?, &|_| ())
    }

    #[test]
    fn part_that_is_pulled_off_the_array_ends_its_run_with_a_note() {
        let outcome = set("force_dyn=0.9 starts=1 time_s=0.5").unwrap();
        let note = "the part left the array in 1 of 1 runs, which end there";
        assert_eq!(outcome.notes, [note]);
        // the part is thrown off before it has settled
        let thrown =
            set("peak_rad=0.2 drive_hz=20000 natural_hz=50000 solidity=1 mass_ug=10 force_dyn=1 starts=1 time_s=0.1");
        assert_eq!(thrown.unwrap().notes, [note]);
    }
}
