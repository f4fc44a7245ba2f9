//! Many runs on all cores, each summarised as soon as it ends.

use std::collections::BTreeMap;

use rand::RngExt;

use super::drive::ResonatorDrive;
use super::measures::{
    Arrival, Cluster, Energies, FeedMeasure, Spread, arrivals, clusters, mean_rate_mps, samples_from, spectrum,
    strongest_line,
};
use super::run::{Run, Setup, Start};
use crate::sweep::Progress;
use upm_core::background::on_all_cores;
use upm_core::random::Streams;
use upm_core::units::mm_from_m;

/// Time after the drop at which the part has settled, s.
pub const SETTLED_S: f64 = 0.05;
/// Band of the part's own bouncing, Hz.
const BOUNCE_HZ: [f64; 2] = [100.0, 4_000.0];
/// Width of the band about the drive's frequency, as a fraction of it.
const DRIVE_BAND: f64 = 0.02;

/// A run to simulate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BatchJob {
    pub setup: Setup,
    /// Number of the random start position.
    pub start: u64,
    pub until_s: f64,
    /// Force along the feed from [`SETTLED_S`] on, N.
    pub force_n: f64,
}

/// Summary of a run after the part has settled.
#[derive(Clone, Debug)]
pub struct Summary {
    /// Double bounces, those that follow them, bounces once a cycle.
    pub clusters: [Cluster; 3],
    /// Mean angle of the resonators at a contact, rad.
    pub angle_rad: f64,
    pub speed_radps: f64,
    pub rate_mps: f64,
    pub feed: FeedMeasure,
    /// Height above rest, m.
    pub height_m: Spread,
    pub energies: Energies,
    /// Frequency, Hz, and amplitude, m, of the strongest line of the part's bouncing.
    pub bounce_line: [f64; 2],
    /// The same at the drive's frequency.
    pub drive_line: [f64; 2],
    /// True when the part was on the array until the end.
    pub stays: bool,
}

/// Runs to simulate together, each with the name of its group.
#[derive(Clone, Debug, Default)]
pub struct Batch(Vec<(String, BatchJob)>);

/// Summaries of a batch's runs by its groups.
pub struct Summaries(BTreeMap<String, Vec<Summary>>);

impl Batch {
    /// Adds `job` from each of `starts` starts.
    pub fn add(&mut self, group: &str, starts: u64, job: BatchJob) {
        self.0.extend((0..starts).map(|start| (group.to_owned(), BatchJob { start, ..job })));
    }

    /// Simulates all runs; equal seeds give equal starts, whatever the setup.
    pub fn summaries(self, streams: &Streams, progress: Progress<'_>) -> Summaries {
        let all = on_all_cores(&self.0, progress, |(_, job)| Summary::of(&job.run(streams)));
        let mut groups: BTreeMap<String, Vec<Summary>> = BTreeMap::new();
        for ((group, _), summary) in self.0.into_iter().zip(all) {
            groups.entry(group).or_default().push(summary);
        }
        Summaries(groups)
    }
}

impl Summaries {
    /// Those of a group.
    pub fn of(&self, group: &str) -> &[Summary] {
        self.0.get(group).map_or(&[], Vec::as_slice)
    }

    /// Mean rate of a group, mm/s.
    pub fn rate_mm_s(&self, group: &str) -> f64 {
        mean(self.of(group), |summary| mm_from_m(summary.rate_mps))
    }

    /// Mean height of a group above rest, µm.
    pub fn height_um(&self, group: &str) -> f64 {
        mean(self.of(group), |summary| 1e6 * summary.height_m.mean)
    }
}

impl BatchJob {
    /// A run of the paper's device and part without a force.
    pub fn published(drive: ResonatorDrive, until_s: f64) -> Self {
        Self { setup: Setup::published(drive), start: 0, until_s, force_n: 0.0 }
    }

    /// Simulates the run, from its drop to its end.
    pub fn run(&self, streams: &Streams) -> Run {
        let mut rng = streams.numbered("mchip", self.start);
        let mut run = Run::new(self.setup, &Start::scattered(|| rng.random_range(0.0..1.0)));
        if run.advance(SETTLED_S.min(self.until_s)) {
            run.force_n.x = self.force_n;
            run.advance(self.until_s);
        }
        run
    }
}

impl Summary {
    pub fn of(run: &Run) -> Self {
        let samples = samples_from(run, SETTLED_S);
        let Setup { device, sample_s, .. } = run.setup;
        let arrivals = arrivals(&run.impacts, SETTLED_S, f64::INFINITY);
        let mean = |of: fn(&Arrival) -> f64| Spread::of(arrivals.iter().map(of)).mean;
        let heights_m: Vec<f64> = samples.iter().map(|sample| run.height_m(&sample.state)).collect();
        let lines = spectrum(&heights_m, sample_s);
        let [from, to] = [1.0 - DRIVE_BAND, 1.0 + DRIVE_BAND].map(|share| share * device.drive_hz);
        Self {
            clusters: clusters(&arrivals, device.drive_hz),
            angle_rad: mean(|arrival| arrival.angle_rad),
            speed_radps: mean(|arrival| arrival.speed_radps),
            rate_mps: mean_rate_mps(samples),
            feed: FeedMeasure::of(samples),
            height_m: Spread::of(heights_m.iter().copied()),
            energies: Energies::of(run, samples),
            bounce_line: strongest_line(&lines, BOUNCE_HZ[0], BOUNCE_HZ[1].min(0.9 * device.drive_hz)),
            drive_line: strongest_line(&lines, from, to),
            stays: run.is_on_array(),
        }
    }
}

/// Mean of a figure over several runs; runs without it are left out.
pub fn mean(summaries: &[Summary], of: impl Fn(&Summary) -> f64) -> f64 {
    let values: Vec<f64> = summaries.iter().map(of).filter(|value| value.is_finite()).collect();
    if values.is_empty() { f64::NAN } else { values.iter().sum::<f64>() / values.len() as f64 }
}

/// Mean over several runs of a figure of one cluster.
pub fn of_cluster(summaries: &[Summary], cluster: usize, of: fn(&Cluster) -> f64) -> f64 {
    mean(summaries, |summary| {
        let cluster = &summary.clusters[cluster];
        if cluster.share > 0.0 { of(cluster) } else { f64::NAN }
    })
}

/// Number of runs whose longest stall exceeds `least_s`, s.
pub fn jams(summaries: &[Summary], least_s: f64) -> f64 {
    summaries.iter().filter(|summary| summary.feed.longest_stall_s > least_s).count() as f64
}
