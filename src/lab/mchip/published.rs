//! The papers' figures of the M-Chip: impacts in clusters, jams and means to free a part, duty, spectrum, energies; the
//! sweeps are in [`super::sweeps`].

use super::batch::{Batch, BatchJob, Summaries, Summary, jams, mean, of_cluster};
use super::device::Device;
use super::drive::ResonatorDrive;
use super::measures::{Cluster, Energies, median};
use super::run::Setup;
use super::{DYN_N, JAM_S, belt, gap_chart, spectrum_chart, sweeps, track_chart};
use crate::sweep::Progress;
use crate::texts::{figure, figures, sheet};
use crate::{DataSheet, ExperimentResult, Figure, LabError, LabRig};
use upm_chart::{Chart, Color};
use upm_core::random::Streams;
use upm_core::units::mm_from_m;

/// Starts of the main figures, and of the additional ones.
const STARTS: u64 = 10;
const FEW: u64 = 3;
/// Length of a run in which a part meets new rows, and of all other runs, s.
const LONG_S: f64 = 1.05;
const SHORT_S: f64 = 0.2;
/// Duties that are compared.
const SHORT_DUTY: f64 = 0.36;
/// Phase offsets from row to row, in cycles.
const OFFSETS: [f64; 4] = [0.125, 0.25, 0.5, 0.75];
/// Compared times for which the strobing turns a row off, in cycles.
const TURNS: [u32; 5] = [20, 37, 50, 75, 100];
/// Frequency with which the strobing of λ = 4 and γ = 50 repeats at 5 kHz, Hz.
const STROBE_HZ: f64 = 25.0;
/// Thickness of 55 µg of silicon with the length and width of the paper's box, m.
const THIN_M: f64 = 51e-6;
/// Points of the curve of the belt's displacement.
const BELT_POINTS: usize = 100;
/// Table I of the Impulse paper, 1e-5 dyn cm: mean and standard deviation of LinX, LinY, LinZ, AngX, AngY, AngZ, PotZ.
const TABLE: [[f64; 2]; 7] =
    [[1.78, 0.71], [0.1, 0.15], [1.38, 1.86], [0.65, 0.86], [0.63, 1.28], [0.0081, 0.045], [50.1, 14.3]];
/// Unit of the table, J.
const TABLE_J: f64 = 1e-12;

/// Reproduces all figures.
///
/// # Errors
///
/// None in the published settings.
pub fn reproduce(rig: &LabRig, progress: Progress<'_>) -> Result<ExperimentResult, LabError> {
    let streams = Streams::new(rig.seed);
    let mut batch = Batch::default();
    add_runs(&mut batch);
    sweeps::add_runs(&mut batch);
    let runs = batch.summaries(&streams, &|share| progress(0.95 * share));
    let mut outcome = ExperimentResult::default();
    outcome.figures.extend(impacts(runs.of("plain"), "50 % duty"));
    outcome.figures.extend(impacts(runs.of("strobed"), "50 % duty, strobed"));
    outcome.figures.extend(short_duty(runs.of("short duty"), runs.of("strobed, short duty")));
    outcome.figures.extend(feed(&runs));
    outcome.figures.extend(bouncing(runs.of("strobed"), "strobed"));
    outcome.figures.extend(bouncing(runs.of("plain, long"), "every row alike"));
    outcome.figures.extend(bouncing(runs.of("soft"), "soft rods"));
    outcome.sheet = Some(energies(runs.of("strobed")));
    sweeps::report(&runs, &mut outcome);
    outcome.figures.extend(beside(&runs));
    outcome.charts.extend(charts(&streams));
    progress(1.0);
    Ok(outcome)
}

/// Runs of one kind: group, starts, length, s, and the change of the paper's array with every row alike.
type ArrayRuns = (&'static str, u64, f64, fn(&mut Setup));

/// Runs of every kind. "plain" ones end before the first jam; the part of "thin" is as thick as 55 µg of silicon.
const RUNS: [ArrayRuns; 7] = [
    ("plain", STARTS, SHORT_S, |_| ()),
    ("plain, long", STARTS, LONG_S, |_| ()),
    ("short duty", STARTS, LONG_S, |setup| setup.drive.duty = SHORT_DUTY),
    ("strobed", STARTS, LONG_S, |setup| setup.drive = ResonatorDrive::strobed()),
    ("strobed, short duty", FEW, LONG_S, |setup| (setup.drive.strobe, setup.drive.duty) = (1, SHORT_DUTY)),
    ("soft", FEW, LONG_S, |setup| setup.device = Device::soft()),
    ("thin", FEW, LONG_S, |setup| (setup.drive.strobe, setup.part.half_m.z) = (1, 0.5 * THIN_M)),
];

fn add_runs(batch: &mut Batch) {
    for (group, starts, until_s, change) in RUNS {
        let mut job = BatchJob::published(ResonatorDrive::plain(), until_s);
        change(&mut job.setup);
        batch.add(group, starts, job);
    }
    for row_delay in OFFSETS {
        let drive = ResonatorDrive { row_delay, ..ResonatorDrive::plain() };
        batch.add(&format!("offset {row_delay}"), FEW, BatchJob::published(drive, LONG_S));
    }
    for cycles in TURNS {
        let drive = ResonatorDrive { cycles, ..ResonatorDrive::strobed() };
        batch.add(&format!("turn {cycles}"), FEW, BatchJob::published(drive, 2.0 * SHORT_S));
    }
}

/// Times between contacts, and differences between double bounces and the others.
fn impacts(summaries: &[Summary], how: &str) -> [Figure; 8] {
    let gap_ms = |cluster: usize| 1e3 * of_cluster(summaries, cluster, |of| of.gap_s);
    let share = |cluster: usize| mean(summaries, |summary| summary.clusters[cluster].share);
    let ratio = |of: fn(&Cluster) -> f64| of_cluster(summaries, 0, of) / of_cluster(summaries, 2, of);
    figures([
        ("{}: gap before a double bounce", gap_ms(0)),
        ("{}: gap after one", gap_ms(1)),
        ("{}: gap of bounces once a cycle", gap_ms(2)),
        ("{}: double bounces, of all contacts", share(0)),
        ("{}: bounces once a cycle, of all contacts", share(2)),
        ("{}: angle at a double bounce over that of others", ratio(|of| of.angle_rad)),
        ("{}: angular speed at one over that of others", ratio(|of| of.speed_radps)),
        ("{}: double bounces that push backward", of_cluster(summaries, 0, |of| of.backward)),
    ])
    .map(|figure| figure.of(how))
}

/// Contacts at a shorter duty, compared with the paper's.
fn short_duty(plain: &[Summary], strobed: &[Summary]) -> [Figure; 3] {
    let doubles = |summaries| mean(summaries, |summary| summary.clusters[0].share);
    figures([
        ("36 % duty: double bounces, of all contacts", doubles(plain)),
        ("36 % duty: contacts once a cycle that push backward", of_cluster(plain, 2, |of| of.backward)),
        ("36 % duty, strobed: double bounces, of all contacts", doubles(strobed)),
    ])
}

/// Rates, jams, and means to free a part.
fn feed(runs: &Summaries) -> [Figure; 11] {
    let moving = |group: &str| mm_from_m(mean(runs.of(group), |summary| summary.feed.moving_mps));
    let longest_ms = |group: &str| 1e3 * mean(runs.of(group), |summary| summary.feed.longest_stall_s);
    let jams = |group: &str| jams(runs.of(group), JAM_S);
    let gain = |with: f64, without: f64| 100.0 * (with / without - 1.0);
    let turns = TURNS.map(|cycles| (f64::from(cycles), runs.rate_mm_s(&format!("turn {cycles}"))));
    let best = turns.into_iter().max_by(|a, b| a.1.total_cmp(&b.1)).map_or(f64::NAN, |(cycles, _)| cycles);
    let strobed = ["strobed, short duty", "strobed"].map(|group| runs.rate_mm_s(group));
    figures([
        ("50 % duty: rate while it moves", moving("plain, long")),
        ("starts that jam within 1 s, of ten", jams("plain, long")),
        ("longest jam", longest_ms("plain, long")),
        (
            "starts that jam with offsets between rows, of 12",
            OFFSETS.map(|delay| jams(&format!("offset {delay}"))).iter().sum(),
        ),
        ("strobed, λ = 4, γ = 50: rate", strobed[1]),
        ("strobed: starts that jam, of ten", jams("strobed")),
        ("strobed: longest stop", longest_ms("strobed")),
        ("strobed: γ with the highest rate, of 20 to 100", best),
        ("36 % duty: rate while it moves", moving("short duty")),
        ("gain of rate by 36 % duty while it moves", gain(moving("short duty"), moving("plain, long"))),
        ("the same, strobed", gain(strobed[0], strobed[1])),
    ])
}

/// The part's height and its spectrum.
fn bouncing(summaries: &[Summary], how: &str) -> [Figure; 5] {
    let median = |of: fn(&Summary) -> f64| median(summaries.iter().map(of).collect());
    let off_harmonic = median(|summary| {
        let orders = summary.bounce_line[0] / STROBE_HZ;
        STROBE_HZ * (orders - orders.round()).abs()
    });
    figures([
        ("{}: line of the bouncing", median(|of| of.bounce_line[0])),
        ("{}: distance of that line from a harmonic of 25 Hz", off_harmonic),
        ("{}: line of the drive", median(|of| of.drive_line[0])),
        ("{}: the first over the second", median(|of| of.bounce_line[1] / of.drive_line[1])),
        ("{}: height above rest", 1e6 * mean(summaries, |of| of.height_m.mean)),
    ])
    .map(|figure| figure.of(how))
}

/// Energies per degree of freedom, compared with Table I.
fn energies(summaries: &[Summary]) -> DataSheet {
    let scaled = |of: &dyn Fn(&Summary) -> f64| mean(summaries, of) / TABLE_J;
    let row = |(i, &[paper, paper_sd]): (usize, &[f64; 2])| {
        let (mean, sd) = (scaled(&|of| of.energies.each[i].mean), scaled(&|of| of.energies.each[i].sd));
        let is_near = (paper / 3.0..=paper * 3.0).contains(&mean);
        vec![(i + 1) as f64, mean, sd, paper, paper_sd, f64::from(u8::from(is_near))]
    };
    let mut rows: Vec<Vec<f64>> = TABLE.iter().enumerate().map(row).collect();
    rows.push(vec![8.0, scaled(&|of| of.energies.drift_j), f64::NAN, f64::NAN, f64::NAN, f64::NAN]);
    sheet("mchip", rows)
}

/// Other models and devices, for comparison.
fn beside(runs: &Summaries) -> Vec<Figure> {
    let potential = mean(runs.of("strobed"), |summary| {
        let Energies { each, drift_j } = &summary.energies;
        each[6].mean / (drift_j + each.iter().map(|one| one.mean).sum::<f64>())
    });
    let angular = |group: &str, axis: usize| mean(runs.of(group), |summary| summary.energies.each[axis].mean);
    let over_pitch = |group: &str, axis: usize| angular(group, axis) / angular(group, 4);
    let paper_share = TABLE[6][0] / TABLE.iter().map(|row| row[0]).sum::<f64>();
    let mut found = vec![figure("PotZ, of all energy, strobed", potential).with(Some(paper_share))];
    found.extend(figures([
        ("AngX over AngY, strobed", over_pitch("strobed", 3)),
        ("the same, part of 51 µm", over_pitch("thin", 3)),
        ("AngZ over AngY, strobed", over_pitch("strobed", 5)),
        ("soft rods: rate", runs.rate_mm_s("soft")),
        ("soft rods: starts that jam, of three", jams(runs.of("soft"), JAM_S)),
        ("belt of Fig. 11: bouncing", belt::bounce_hz()),
        ("belt of Fig. 11: depth of the part", 1e6 * belt::depth_m()),
        ("belt of Fig. 11: slope of the rate over force", mm_from_m(belt::slope_mpspn()) * DYN_N),
    ]));
    found
}

/// Tracks with and without strobing and on the belt of Fig. 11, contacts at both duties, the spectrum.
fn charts(streams: &Streams) -> [Chart; 4] {
    let run = |drive, until_s| BatchJob::published(drive, until_s).run(streams);
    let [plain, strobed] = [ResonatorDrive::plain(), ResonatorDrive::strobed()].map(|drive| run(drive, LONG_S));
    let times_s = (0..=BELT_POINTS).map(|i| LONG_S * i as f64 / BELT_POINTS as f64);
    let way = times_s.map(|t_s| [t_s, mm_from_m(belt::way_m(t_s))]);
    let jam = track_chart("mchip-jam", &[("every row alike", &plain), ("rows strobed", &strobed)]);
    [
        jam.dashes("belt of Fig. 11, 1.1 mm/s", Color::Gray, way),
        gap_chart("mchip-collisions-50", &strobed),
        gap_chart("mchip-collisions-36", &run(ResonatorDrive { duty: SHORT_DUTY, ..ResonatorDrive::plain() }, SHORT_S)),
        spectrum_chart(&strobed),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{assert_sources_are_short, lab_rig};

    /// The whole reproduction takes minutes of one core: this test covers a few short runs.
    #[test]
    fn figures_of_a_few_runs_are_like_the_papers() {
        let mut batch = Batch::default();
        for (group, drive) in [
            ("plain", ResonatorDrive::plain()),
            ("strobed", ResonatorDrive::strobed()),
            ("short", ResonatorDrive { duty: SHORT_DUTY, ..ResonatorDrive::plain() }),
        ] {
            batch.add(group, 2, BatchJob::published(drive, SHORT_S));
        }
        let runs = batch.summaries(&Streams::new(3), &|_| ());
        let [plain, strobed, short] = ["plain", "strobed", "short"].map(|group| runs.of(group));
        let impacts = [impacts(plain, "50 %"), impacts(strobed, "strobed")].concat();
        let others = short_duty(short, strobed).into_iter().chain(bouncing(strobed, "strobed"));
        let figures: Vec<Figure> = impacts.into_iter().chain(others).collect();
        assert_sources_are_short(&ExperimentResult { figures: figures.clone(), ..ExperimentResult::default() });
        let figure = |name: &str| figures.iter().find(|figure| figure.name == name).unwrap().measured;
        assert!(figure("50 %: double bounces that push backward") > 0.9);
        assert!(figure("50 %: angular speed at one over that of others") < 0.4);
        assert!(figure("36 % duty: double bounces, of all contacts") < 0.01);
        let table = energies(strobed);
        assert!(table.rows.len() == 8 && table.rows[6][1] > 10.0 * table.rows[2][1], "most energy is potential");
    }

    #[test]
    #[ignore = "campaign: `cargo test -p upm-lab -- --ignored campaign_of` runs it"]
    fn campaign_of_seeds_gives_the_same_classes_of_figures() {
        let classes = |seed| {
            let outcome = reproduce(&LabRig { seed, ..lab_rig("upm-1") }, &|_| ()).unwrap();
            assert_sources_are_short(&outcome);
            outcome.figures.into_iter().map(|figure| [figure.name, figure.source]).collect::<Vec<_>>()
        };
        assert_eq!(classes(1), classes(12));
    }
}
