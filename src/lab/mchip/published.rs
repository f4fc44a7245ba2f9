//! The papers' figures of the M-Chip: impacts in clusters, jams and means to free a part, duty, spectrum, energies; the
//! sweeps are in [`super::sweeps`].

use super::batch::{Batch, BatchJob, Summaries, Summary, jams, mean, median, of_cluster};
use super::device::Device;
use super::drive::ResonatorDrive;
use super::impact::ImpactLaw;
use super::measures::{Cluster, Energies};
use super::run::Setup;
use super::{DYN_N, JAM_S, belt, gap_chart, spectrum_chart, sweeps, track_chart};
use crate::sweep::Progress;
use crate::{DataSheet, ExperimentResult, Figure, LabFault, LabRig};
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
pub fn reproduce(rig: &LabRig, progress: Progress<'_>) -> Result<ExperimentResult, LabFault> {
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

/// The paper's drive with this duty.
fn at_duty(duty: f64, drive: ResonatorDrive) -> Setup {
    Setup::published(ResonatorDrive { duty, ..drive })
}

/// Runs of every kind. "plain" ones end before the first jam; the part of "thin" is as thick as 55 µg of silicon.
fn add_runs(batch: &mut Batch) {
    let (plain, strobed) = (Setup::published(ResonatorDrive::plain()), Setup::published(ResonatorDrive::strobed()));
    batch.add("plain", &plain, STARTS, SHORT_S);
    batch.add("plain, long", &plain, STARTS, LONG_S);
    batch.add("short duty", &at_duty(SHORT_DUTY, ResonatorDrive::plain()), STARTS, LONG_S);
    batch.add("strobed", &strobed, STARTS, LONG_S);
    batch.add("strobed, short duty", &at_duty(SHORT_DUTY, ResonatorDrive::strobed()), FEW, LONG_S);
    for row_delay in OFFSETS {
        let setup = Setup::published(ResonatorDrive { row_delay, ..ResonatorDrive::plain() });
        batch.add(&format!("offset {row_delay}"), &setup, FEW, LONG_S);
    }
    for cycles in TURNS {
        let setup = Setup::published(ResonatorDrive { cycles, ..ResonatorDrive::strobed() });
        batch.add(&format!("turn {cycles}"), &setup, FEW, 2.0 * SHORT_S);
    }
    for duty in [0.5, SHORT_DUTY] {
        let setup = at_duty(duty, ResonatorDrive::plain());
        let nominal = Setup { device: Device::nominal(), sample_s: 1e-4, ..setup };
        batch.add(&format!("nominal {duty}"), &nominal, FEW, 2.0 * SHORT_S);
    }
    batch.add("soft", &Setup { device: Device::soft(), ..plain.clone() }, FEW, LONG_S);
    let mut thin = strobed;
    thin.part.half_m.z = 0.5 * THIN_M;
    batch.add("thin", &thin, FEW, LONG_S);
    batch.add("algebraic", &Setup { law: ImpactLaw::Algebraic, ..plain }, FEW, SHORT_S);
}

/// Times between contacts, and differences between double bounces and the others.
fn impacts(summaries: &[Summary], how: &str) -> Vec<Figure> {
    const SOURCE: &str = "M-Chip paper, Fig. 7";
    let gap = |cluster: usize, name: &str, paper_ms: f64, accepted: [f64; 2]| {
        let gap_ms = 1e3 * of_cluster(summaries, cluster, |of| of.gap_s);
        Figure::against(format!("{how}: {name}"), "ms", gap_ms, paper_ms, SOURCE).judged(accepted)
    };
    let ratio = |name: &str, of: fn(&Cluster) -> f64, paper: &str, accepted: [f64; 2]| {
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
fn feed(runs: &Summaries) -> Vec<Figure> {
    let moving = |summaries: &[Summary]| mm_from_m(mean(summaries, |summary| summary.feed.moving_mps));
    let rate = |summaries: &[Summary]| mm_from_m(mean(summaries, |summary| summary.rate_mps));
    let longest_ms = |summaries: &[Summary]| 1e3 * mean(summaries, |summary| summary.feed.longest_stall_s);
    let (plain, strobed, short) = (runs.of("plain, long"), runs.of("strobed"), runs.of("short duty"));
    let offsets: f64 = OFFSETS.iter().map(|delay| jams(runs.of(&format!("offset {delay}")), JAM_S)).sum();
    let gain = |with: f64, without: f64| 100.0 * (with / without - 1.0);
    let percent = |name: &str, value: f64| Figure::alone(name, "%", value, "20 to 40 %").judged([20.0, 40.0]);
    let turns = TURNS.map(|cycles| rate(runs.of(&format!("turn {cycles}"))));
    let best =
        TURNS.iter().zip(&turns).max_by(|a, b| a.1.total_cmp(b.1)).map_or(f64::NAN, |(turn, _)| f64::from(*turn));
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
        percent("the same, strobed", gain(rate(runs.of("strobed, short duty")), rate(strobed))),
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
    let row = |(i, &[paper, paper_sd]): (usize, &[f64; 2])| {
        let (mean, sd) = (scaled(&|of| of.energies.each[i].mean), scaled(&|of| of.energies.each[i].sd));
        let is_near = (paper / 3.0..=paper * 3.0).contains(&mean);
        vec![(i + 1) as f64, mean, sd, paper, paper_sd, f64::from(u8::from(is_near))]
    };
    let mut rows: Vec<Vec<f64>> = TABLE.iter().enumerate().map(row).collect();
    rows.push(vec![8.0, scaled(&|of| of.energies.drift_j), f64::NAN, f64::NAN, f64::NAN, f64::NAN]);
    DataSheet::new(columns, rows)
}

/// Other models and devices, for comparison.
fn beside(runs: &Summaries) -> Vec<Figure> {
    let rate = |group: &str| mm_from_m(mean(runs.of(group), |summary| summary.rate_mps));
    let rate_alone = |name: &str, group: &str, source: &str| Figure::alone(name, "mm/s", rate(group), source);
    let strobed = runs.of("strobed");
    let share = mean(strobed, |summary| {
        let Energies { each, drift_j } = &summary.energies;
        each[6].mean / (drift_j + each.iter().map(|one| one.mean).sum::<f64>())
    });
    let roll = |summaries: &[Summary], i: usize| {
        let angular = |i: usize| mean(summaries, |summary| summary.energies.each[i].mean);
        angular(i) / angular(4)
    };
    let paper_share = TABLE[6][0] / TABLE.iter().map(|row| row[0]).sum::<f64>();
    let [sinks, bounces] = [1e6 * belt::depth_m(), belt::bounce_hz()];
    let slope = mm_from_m(belt::slope_mpspn()) * DYN_N;
    let nominal = "the designers' device, 1 kHz and 2°: no figure";
    let soft_jams = jams(runs.of("soft"), JAM_S);
    let table = "Impulse paper, Table I";
    vec![
        Figure::against("PotZ, of all energy, strobed", "1", share, paper_share, table).judged([0.8, 1.0]),
        Figure::against("AngX over AngY, strobed", "1", roll(strobed, 3), 1.03, table).judged([0.5, 2.0]),
        Figure::against("the same, part of 51 µm", "1", roll(runs.of("thin"), 3), 1.03, table).judged([0.5, 2.0]),
        Figure::against("AngZ over AngY, strobed", "1", roll(strobed, 5), 0.013, table).judged([0.0, 0.05]),
        rate_alone("nominal device, 50 % duty: rate", "nominal 0.5", nominal),
        rate_alone("nominal device, 36 % duty: rate", "nominal 0.36", nominal),
        Figure::against("soft rods: rate", "mm/s", rate("soft"), 0.8, "M-Chip paper, III").judged([0.6, 1.0]),
        Figure::against("soft rods: starts that jam, of three", "1", soft_jams, 3.0, "M-Chip paper, III")
            .judged([2.0, 3.0]),
        rate_alone("rate with algebraic impacts", "algebraic", "friction by the first slip alone"),
        Figure::against("belt of Fig. 11: bouncing", "Hz", bounces, 370.0, "294 dyn/cm and 55 µg"),
        Figure::alone("belt of Fig. 11: depth of the part", "µm", sinks, "294 dyn/cm and 55 µg"),
        Figure::against("belt of Fig. 11: slope of the rate over force", "mm/s/dyn", slope, 19.6, table),
    ]
}

/// Tracks with and without strobing and on the belt of Fig. 11, contacts at both duties, the spectrum.
fn charts(streams: &Streams) -> Vec<Chart> {
    let run = |setup: Setup, until_s| BatchJob { setup, start: 0, until_s, force_n: 0.0 }.run(streams);
    let plain = run(Setup::published(ResonatorDrive::plain()), LONG_S);
    let strobed = run(Setup::published(ResonatorDrive::strobed()), LONG_S);
    let short = run(at_duty(SHORT_DUTY, ResonatorDrive::plain()), SHORT_S);
    let times_s = (0..=BELT_POINTS).map(|i| LONG_S * i as f64 / BELT_POINTS as f64);
    let way = times_s.map(|t_s| [t_s, mm_from_m(belt::way_m(t_s))]);
    vec![
        track_chart("mchip-jam", &[("every row alike", &plain), ("rows strobed", &strobed)]).dashes(
            "belt of Fig. 11, 1.1 mm/s",
            Color::Gray,
            way,
        ),
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
        batch.add("plain", &Setup::published(ResonatorDrive::plain()), 2, SHORT_S);
        batch.add("strobed", &Setup::published(ResonatorDrive::strobed()), 2, SHORT_S);
        batch.add("short", &at_duty(SHORT_DUTY, ResonatorDrive::plain()), 2, SHORT_S);
        let runs = batch.summaries(&Streams::new(3), &|_| ());
        let [plain, strobed, short] = ["plain", "strobed", "short"].map(|group| runs.of(group));
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
