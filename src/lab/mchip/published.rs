//! The papers' figures of the M-Chip: impacts in clusters, jams and means to free a part, duty, spectrum, energies; the
//! sweeps are in [`super::sweeps`].

use std::ops::Range;

use super::batch::{Batch, BatchJob, Summary, jams, mean, median, of_cluster};
use super::belt::Belt;
use super::device::Device;
use super::drive::{ResonatorDrive, Strobe};
use super::impact::ImpactLaw;
use super::run::Setup;
use super::sweeps::Sweeps;
use super::{DYN_N, JAM_S, gap_chart, spectrum_chart, track_chart};
use crate::sweep::Progress;
use crate::{DataSheet, ExperimentResult, Figure, LabFault, LabRig};
use upm_chart::{Chart, Color, Layer, Mark};
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
const TURNS: [usize; 5] = [20, 37, 50, 75, 100];
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

/// Ranges of the runs of each kind among the summaries.
struct RunRanges {
    /// Runs that end before the first jam.
    plain: Range<usize>,
    plain_long: Range<usize>,
    short_duty: Range<usize>,
    strobed: Range<usize>,
    strobed_short_duty: Range<usize>,
    offsets: Vec<Range<usize>>,
    turns: Vec<Range<usize>>,
    nominal: [Range<usize>; 2],
    algebraic: Range<usize>,
    soft: Range<usize>,
    /// A part as thick as 55 µg of silicon, strobed.
    thin: Range<usize>,
}

/// Reproduces all figures.
///
/// # Errors
///
/// None in the published settings.
pub fn reproduce(rig: &LabRig, progress: Progress<'_>) -> Result<ExperimentResult, LabFault> {
    let streams = Streams::new(rig.seed);
    let mut batch = Batch::default();
    let places = RunRanges::new(&mut batch);
    let sweeps = Sweeps::new(&mut batch);
    let summaries = batch.summaries(&streams, &|share| progress(0.95 * share));
    let of = |range: &Range<usize>| summaries.get(range.clone()).unwrap_or(&[]);
    let mut outcome = ExperimentResult::default();
    outcome.figures.extend(impacts(of(&places.plain), "50 % duty"));
    outcome.figures.extend(impacts(of(&places.strobed), "50 % duty, strobed"));
    outcome.figures.extend(short_duty(of(&places.short_duty), of(&places.strobed_short_duty)));
    outcome.figures.extend(feed(&places, &of));
    outcome.figures.extend(bouncing(of(&places.strobed), "strobed"));
    outcome.figures.extend(bouncing(of(&places.plain_long), "every row alike"));
    outcome.figures.extend(bouncing(of(&places.soft), "soft rods"));
    outcome.sheet = Some(energies(of(&places.strobed)));
    sweeps.report(&of, &mut outcome);
    outcome.figures.extend(beside(&places, &of));
    outcome.charts.extend(charts(&streams));
    progress(1.0);
    Ok(outcome)
}

/// The paper's drive with this duty.
fn at_duty(duty: f64, drive: ResonatorDrive) -> Setup {
    Setup::published(ResonatorDrive { duty, ..drive })
}

impl RunRanges {
    fn new(batch: &mut Batch) -> Self {
        let (plain, strobed) = (Setup::published(ResonatorDrive::plain()), Setup::published(ResonatorDrive::strobed()));
        let offset = |row_delay| Setup::published(ResonatorDrive { row_delay, ..ResonatorDrive::plain() });
        let turn = |cycles| ResonatorDrive { strobe: Some(Strobe { spacing: 4, cycles }), ..ResonatorDrive::plain() };
        let nominal =
            |duty| Setup { device: Device::nominal(), sample_s: 1e-4, ..at_duty(duty, ResonatorDrive::plain()) };
        let soft = Setup { device: Device::soft(), ..plain.clone() };
        let mut thin = strobed.clone();
        thin.part.half_m.z = 0.5 * THIN_M;
        Self {
            plain: batch.add(&plain, STARTS, SHORT_S),
            plain_long: batch.add(&plain, STARTS, LONG_S),
            short_duty: batch.add(&at_duty(SHORT_DUTY, ResonatorDrive::plain()), STARTS, LONG_S),
            strobed: batch.add(&strobed, STARTS, LONG_S),
            strobed_short_duty: batch.add(&at_duty(SHORT_DUTY, ResonatorDrive::strobed()), FEW, LONG_S),
            offsets: OFFSETS.map(|row_delay| batch.add(&offset(row_delay), FEW, LONG_S)).to_vec(),
            turns: TURNS.map(|cycles| batch.add(&Setup::published(turn(cycles)), FEW, 2.0 * SHORT_S)).to_vec(),
            nominal: [0.5, SHORT_DUTY].map(|duty| batch.add(&nominal(duty), FEW, 2.0 * SHORT_S)),
            soft: batch.add(&soft, FEW, LONG_S),
            thin: batch.add(&thin, FEW, LONG_S),
            algebraic: batch.add(&Setup { law: ImpactLaw::Algebraic, ..plain }, FEW, SHORT_S),
        }
    }
}

/// Times between contacts, and differences between double bounces and the others.
fn impacts(summaries: &[Summary], how: &str) -> Vec<Figure> {
    const SOURCE: &str = "M-Chip paper, Fig. 7";
    let gap = |cluster: usize, name: &str, paper_ms: f64, accepted: [f64; 2]| {
        let gap_ms = 1e3 * of_cluster(summaries, cluster, |of| of.gap_s);
        Figure::against(format!("{how}: {name}"), "ms", gap_ms, paper_ms, SOURCE).judged(accepted)
    };
    let ratio = |name: &str, of: fn(&super::measures::Cluster) -> f64, paper: &str, accepted: [f64; 2]| {
        let value = of_cluster(summaries, 0, of) / of_cluster(summaries, 2, of);
        Figure::alone(format!("{how}: {name}"), "1", value, paper).judged(accepted)
    };
    let share = |cluster: usize, name: &str| {
        let value = mean(summaries, |summary| summary.clusters[cluster].share);
        Figure::alone(format!("{how}: {name}, of all contacts"), "1", value, "ten starts")
    };
    let backward = of_cluster(summaries, 0, |of| of.backward);
    vec![
        gap(0, "gap before a double bounce", 0.02, [0.015, 0.03]),
        gap(1, "gap after one", 0.18, [0.165, 0.195]),
        gap(2, "gap of bounces once a cycle", 0.2, [0.195, 0.205]),
        share(0, "double bounces"),
        share(2, "bounces once a cycle"),
        ratio("angle at a double bounce over that of others", |of| of.angle_rad, "lower", [0.0, 0.995]),
        ratio("angular speed at one over that of others", |of| of.speed_radps, "much lower", [0.0, 0.5]),
        Figure::alone(format!("{how}: double bounces that push backward"), "1", backward, "most").judged([0.5, 1.0]),
    ]
}

/// Contacts at a shorter duty, compared with the paper's.
fn short_duty(plain: &[Summary], strobed: &[Summary]) -> Vec<Figure> {
    let [doubles, strobed] = [plain, strobed].map(|of| mean(of, |summary| summary.clusters[0].share));
    let backward = of_cluster(plain, 2, |of| of.backward);
    vec![
        Figure::against("36 % duty: double bounces, of all contacts", "1", doubles, 0.0, "M-Chip paper: none")
            .judged([0.0, 0.02]),
        Figure::alone("36 % duty: contacts once a cycle that push backward", "1", backward, "M-Chip paper: about half")
            .judged([0.4, 0.6]),
        Figure::alone("36 % duty, strobed: double bounces, of all contacts", "1", strobed, "parked rows brake"),
    ]
}

/// Rates, jams, and means to free a part.
fn feed<'a>(places: &RunRanges, of: &impl Fn(&Range<usize>) -> &'a [Summary]) -> Vec<Figure> {
    let moving = |summaries: &[Summary]| mm_from_m(mean(summaries, |summary| summary.feed.moving_mps));
    let rate = |summaries: &[Summary]| mm_from_m(mean(summaries, |summary| summary.rate_mps));
    let longest_ms = |summaries: &[Summary]| 1e3 * mean(summaries, |summary| summary.feed.longest_stall_s());
    let (plain, strobed, short) = (of(&places.plain_long), of(&places.strobed), of(&places.short_duty));
    let offsets: f64 = places.offsets.iter().map(|range| jams(of(range), JAM_S)).sum();
    let gain = |with: f64, without: f64| 100.0 * (with / without - 1.0);
    let percent = |name: &str, value: f64| Figure::alone(name, "%", value, "20 to 40 %").judged([20.0, 40.0]);
    let turns: Vec<f64> = places.turns.iter().map(|range| rate(of(range))).collect();
    let best = TURNS.iter().zip(&turns).max_by(|a, b| a.1.total_cmp(b.1)).map_or(f64::NAN, |(turn, _)| *turn as f64);
    let against = |name: &str, unit: &str, value: f64, paper: f64, accepted: [f64; 2]| {
        Figure::against(name, unit, value, paper, "M-Chip paper, III").judged(accepted)
    };
    vec![
        against("50 % duty: rate while it moves", "mm/s", moving(plain), 0.8, [0.6, 1.0]),
        against("starts that jam within 1 s, of ten", "1", jams(plain, JAM_S), STARTS as f64, [8.0, 10.0]),
        Figure::alone("longest jam", "ms", longest_ms(plain), "runs of 1.05 s"),
        against("starts that jam with offsets between rows, of 12", "1", offsets, 12.0, [9.0, 12.0]),
        against("strobed, λ = 4, γ = 50: rate", "mm/s", rate(strobed), 0.8, [0.6, 1.0]),
        against("strobed: starts that jam, of ten", "1", jams(strobed, JAM_S), 0.0, [0.0, 1.0]),
        Figure::alone("strobed: longest stop", "ms", longest_ms(strobed), "M-Chip paper: short").judged([0.0, 100.0]),
        against("strobed: γ with the highest rate, of 20 to 100", "1", best, 50.0, [37.0, 63.0]),
        against("36 % duty: rate while it moves", "mm/s", moving(short), 1.05, [0.75, 1.38]),
        percent("gain of rate by 36 % duty while it moves", gain(moving(short), moving(plain))),
        percent("the same, strobed", gain(rate(of(&places.strobed_short_duty)), rate(strobed))),
    ]
}

/// The part's height and its spectrum.
fn bouncing(summaries: &[Summary], how: &str) -> Vec<Figure> {
    const FIG_9: &str = "M-Chip paper, IV-A";
    let ratio = median(summaries, |summary| summary.bounce_line[1] / summary.drive_line[1]);
    let hz = |name: &str, of: fn(&Summary) -> f64, paper_hz, accepted| {
        Figure::against(format!("{how}: {name}"), "Hz", median(summaries, of), paper_hz, FIG_9).judged(accepted)
    };
    let alone =
        |name: &str, unit: &str, value: f64, source: &str| Figure::alone(format!("{how}: {name}"), unit, value, source);
    let off_harmonic = median(summaries, |summary| {
        let orders = summary.bounce_line[0] / STROBE_HZ;
        STROBE_HZ * (orders - orders.round()).abs()
    });
    vec![
        hz("line of the bouncing", |of| of.bounce_line[0], 360.0, [240.0, 480.0]),
        alone("distance of that line from a harmonic of 25 Hz", "Hz", off_harmonic, "lines 1 Hz apart; by chance 6"),
        hz("line of the drive", |of| of.drive_line[0], 5_000.0, [4_990.0, 5_010.0]),
        alone("the first over the second", "1", ratio, "5 of the paper's line at 360 Hz"),
        alone("height above rest", "µm", 1e6 * mean(summaries, |of| of.height_m.mean), "9.3 by PotZ at 550 µg"),
    ]
}

/// Energies per degree of freedom, compared with Table I.
fn energies(summaries: &[Summary]) -> DataSheet {
    let columns = [
        "energy (1e-5 dyn cm): 1-3 Lin X Y Z, 4-6 Ang X Y Z, 7 Pot Z, 8 drift along X",
        "here, mean",
        "here, sd",
        "paper, mean",
        "paper, sd",
        "reproduced within a factor of 3: 1, else 0",
    ];
    let scaled = |of: &dyn Fn(&Summary) -> f64| mean(summaries, of) / TABLE_J;
    let row = |i: usize, mean: f64, sd: f64| {
        let [paper, paper_sd] = TABLE[i];
        let is_near = (paper / 3.0..=paper * 3.0).contains(&mean);
        vec![(i + 1) as f64, mean, sd, paper, paper_sd, f64::from(u8::from(is_near))]
    };
    let mut rows: Vec<Vec<f64>> = (0..6)
        .map(|i| row(i, scaled(&|of| of.energies.jitter[i].mean), scaled(&|of| of.energies.jitter[i].sd)))
        .collect();
    rows.push(row(6, scaled(&|of| of.energies.potential.mean), scaled(&|of| of.energies.potential.sd)));
    rows.push(vec![8.0, scaled(&|of| of.energies.drift_j), f64::NAN, f64::NAN, f64::NAN, f64::NAN]);
    DataSheet::new(columns, rows)
}

/// Other models and devices, for comparison.
fn beside<'a>(places: &RunRanges, of: &impl Fn(&Range<usize>) -> &'a [Summary]) -> Vec<Figure> {
    let rate = |range: &Range<usize>| mm_from_m(mean(of(range), |summary| summary.rate_mps));
    let rate_alone = |name: &str, range: &Range<usize>, source: &str| Figure::alone(name, "mm/s", rate(range), source);
    let belt = Belt::published();
    let strobed = of(&places.strobed);
    let share = mean(strobed, |summary| {
        let energies = &summary.energies;
        let others = energies.drift_j + energies.jitter.iter().map(|one| one.mean).sum::<f64>();
        energies.potential.mean / (energies.potential.mean + others)
    });
    let roll = |summaries: &[Summary], i: usize| {
        let angular = |i: usize| mean(summaries, |summary| summary.energies.jitter[i].mean);
        angular(i) / angular(4)
    };
    let paper_share = TABLE[6][0] / TABLE.iter().map(|row| row[0]).sum::<f64>();
    let [sinks, bounces] = [1e6 * belt.depth_m(), belt.bounce_hz()];
    let slope = mm_from_m(belt.slope_mpspn()) * DYN_N;
    let nominal = "the designers' device, 1 kHz and 2°: no figure";
    let soft_jams = jams(of(&places.soft), JAM_S);
    let table = "Impulse paper, Table I";
    vec![
        Figure::against("PotZ, of all energy, strobed", "1", share, paper_share, table).judged([0.8, 1.0]),
        Figure::against("AngX over AngY, strobed", "1", roll(strobed, 3), 1.03, table).judged([0.5, 2.0]),
        Figure::against("the same, part of 51 µm", "1", roll(of(&places.thin), 3), 1.03, table).judged([0.5, 2.0]),
        Figure::against("AngZ over AngY, strobed", "1", roll(strobed, 5), 0.013, table).judged([0.0, 0.05]),
        rate_alone("nominal device, 50 % duty: rate", &places.nominal[0], nominal),
        rate_alone("nominal device, 36 % duty: rate", &places.nominal[1], nominal),
        Figure::against("soft rods: rate", "mm/s", rate(&places.soft), 0.8, "M-Chip paper, III").judged([0.6, 1.0]),
        Figure::against("soft rods: starts that jam, of three", "1", soft_jams, 3.0, "M-Chip paper, III")
            .judged([2.0, 3.0]),
        rate_alone("rate with algebraic impacts", &places.algebraic, "friction by the first slip alone"),
        Figure::against("belt of Fig. 11: bouncing", "Hz", bounces, 370.0, "294 dyn/cm and 55 µg"),
        Figure::alone("belt of Fig. 11: depth of the part", "µm", sinks, "294 dyn/cm and 55 µg"),
        Figure::against("belt of Fig. 11: slope of the rate over force", "mm/s/dyn", slope, 19.6, table),
    ]
}

/// A chart of tracks with that of a part on the belt of Fig. 11 added.
fn with_belt(mut chart: Chart) -> Chart {
    let belt = Belt::published();
    let way = (0..=BELT_POINTS).map(|i| LONG_S * i as f64 / BELT_POINTS as f64);
    let points = way.map(|t_s| [t_s, mm_from_m(belt.way_m(0.0, t_s))]);
    chart.layers.push(Layer::new("belt of Fig. 11, 1.1 mm/s", Mark::Dashes, Color::Gray, points));
    chart
}

/// Tracks with and without strobing, contacts at both duties, the spectrum.
fn charts(streams: &Streams) -> Vec<Chart> {
    let run = |setup: Setup, until_s| BatchJob { setup, start: 0, until_s, force_n: 0.0 }.run(streams);
    let plain = run(Setup::published(ResonatorDrive::plain()), LONG_S);
    let strobed = run(Setup::published(ResonatorDrive::strobed()), LONG_S);
    let short = run(at_duty(SHORT_DUTY, ResonatorDrive::plain()), SHORT_S);
    vec![
        with_belt(track_chart("mchip-jam", &[("every row alike", &plain), ("rows strobed", &strobed)])),
        gap_chart("mchip-collisions-50", &strobed),
        gap_chart("mchip-collisions-36", &short),
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
        let ranges = [
            batch.add(&Setup::published(ResonatorDrive::plain()), 2, SHORT_S),
            batch.add(&Setup::published(ResonatorDrive::strobed()), 2, SHORT_S),
            batch.add(&at_duty(SHORT_DUTY, ResonatorDrive::plain()), 2, SHORT_S),
        ];
        let found = batch.summaries(&Streams::new(3), &|_| ());
        let [plain, strobed, short] = ranges.map(|range| &found[range]);
        let figures = [
            impacts(plain, "50 %"),
            impacts(strobed, "strobed"),
            short_duty(short, strobed),
            bouncing(strobed, "strobed"),
        ];
        let figures = figures.concat();
        assert_sources_are_short(&ExperimentResult { figures: figures.clone(), ..ExperimentResult::default() });
        let figure = |name: &str| figures.iter().find(|figure| figure.name == name).unwrap().measured;
        assert!(figure("50 %: double bounces that push backward") > 0.9);
        assert!(figure("50 %: angular speed at one over that of others") < 0.4);
        assert!(figure("36 % duty: double bounces, of all contacts") < 0.01);
        let table = energies(strobed);
        assert!(table.rows.len() == 8 && table.rows[6][1] > 10.0 * table.rows[2][1], "most energy is potential");
    }

    #[test]
    #[ignore = "long: `cargo test -- --ignored` runs it"]
    fn classes_of_the_figures_hold_for_other_seeds() {
        let classes = |seed| {
            let outcome = reproduce(&LabRig { seed, ..lab_rig("upm-1") }, &|_| ()).unwrap();
            assert_sources_are_short(&outcome);
            outcome.figures.into_iter().map(|figure| [figure.name, figure.source]).collect::<Vec<_>>()
        };
        assert_eq!(classes(1), classes(12));
    }
}
