//! Sees that recordings leave room on the disk: none is begun that might fill it, and the present ones are stopped when
//! it runs low. The plates go on.

use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread;
use std::time::Duration;

use super::shared::Shared;
use super::watchdog::ms;
use crate::time::{Clock, MonotonicClock};

/// How often the disk is looked at.
const APART: Duration = Duration::from_secs(1);
/// What the last look saw holds so long. A look that takes longer hangs.
const HOLDS: Duration = Duration::from_secs(5);
/// Bytes a second of plate time that a recording is thought to take before there was one. Recordings of the plus sign
/// take 0.1 MB/s, those of eight coins 0.2 MB/s; this is twice as much.
const FIRST_RATE: f64 = 0.4e6;
/// Recordings that tell what the next will take.
const RATES: usize = 10;
/// Shorter ones are mostly what every recording begins with, s.
const SHORTEST_S: f64 = 1.0;
const UNKNOWN: u64 = u64::MAX;

/// What is known of the room on the disk.
#[derive(Debug)]
pub(super) struct Disk {
    min_free_bytes: u64,
    /// [`UNKNOWN`] when the disk does not say.
    free_bytes: AtomicU64,
    looked_ms: AtomicU64,
    /// True once it was said that the disk does not answer.
    told: AtomicBool,
    ending: AtomicBool,
}

impl Disk {
    /// Looks for the first time at the disk of `folder`.
    pub fn new(folder: &Path, min_free_bytes: u64, clock: &MonotonicClock) -> Self {
        Self {
            min_free_bytes,
            free_bytes: AtomicU64::new(free_bytes(folder).unwrap_or(UNKNOWN)),
            looked_ms: AtomicU64::new(ms(clock.elapsed())),
            told: AtomicBool::new(false),
            ending: AtomicBool::new(false),
        }
    }

    /// What is free, in bytes; `None` when the disk does not say.
    pub fn free_bytes(&self, now: Duration) -> Option<u64> {
        let free = self.free_bytes.load(Ordering::Relaxed);
        (free != UNKNOWN && !self.hangs(now)).then_some(free)
    }

    /// Whether `wanted_bytes` may be written; why not. A disk that does not say what is free is trusted.
    pub fn has_room(&self, wanted_bytes: u64, now: Duration) -> Result<(), String> {
        let Some(free) = self.free_bytes(now) else { return Ok(()) };
        if free >= wanted_bytes.saturating_add(self.min_free_bytes) {
            return Ok(());
        }
        let [wanted, free, kept] = [wanted_bytes, free, self.min_free_bytes].map(megabytes);
        Err(format!("it may take {wanted}, the disk has {free} left, of which {kept} stay free"))
    }

    /// Says it once when the disk does not answer.
    pub fn heed(&self, now: Duration) {
        if self.hangs(now) && !self.told.swap(true, Ordering::Relaxed) {
            tracing::error!("the disk does not say what is free: no answer for {} s", HOLDS.as_secs());
        }
    }

    fn hangs(&self, now: Duration) -> bool {
        now.saturating_sub(Duration::from_millis(self.looked_ms.load(Ordering::Relaxed))) > HOLDS
    }

    fn saw(&self, free: Option<u64>, now: Duration) {
        self.free_bytes.store(free.unwrap_or(UNKNOWN), Ordering::Relaxed);
        self.looked_ms.store(ms(now), Ordering::Relaxed);
        if self.told.swap(false, Ordering::Relaxed) {
            tracing::info!("the disk answers again");
        }
    }

    /// No more looks.
    pub fn end(&self) {
        self.ending.store(true, Ordering::Relaxed);
    }
}

/// Looks at the disk all the time, on a thread of its own: a dead disk lets whoever asks it wait for good.
pub(super) struct DiskGuard {
    pub disk: Arc<Disk>,
    pub folder: PathBuf,
    pub plates: Vec<Arc<Shared>>,
    pub clock: MonotonicClock,
}

impl DiskGuard {
    /// Looks until it is told to end.
    pub fn run(self) {
        while !self.disk.ending.load(Ordering::Relaxed) {
            self.saw(free_bytes(&self.folder));
            thread::park_timeout(APART);
        }
    }

    /// Stops every recording when so little is free.
    pub fn saw(&self, free: Option<u64>) {
        self.disk.saw(free, self.clock.elapsed());
        let low = free.filter(|&free| free < self.disk.min_free_bytes);
        let Some(free) = low else { return };
        let reason = format!("the disk has only {} left", megabytes(free));
        for recording in self.plates.iter().filter_map(|plate| plate.recording()) {
            recording.stop(&reason);
        }
    }
}

/// What the newest recordings of a plate took, bytes a second of plate time.
#[derive(Debug, Default)]
pub(super) struct Rates(VecDeque<f64>);

impl Rates {
    /// A whole recording of so long took so much.
    pub fn add(&mut self, bytes: u64, plate_time_s: f64) {
        if plate_time_s >= SHORTEST_S {
            self.0.truncate(RATES - 1);
            self.0.push_front(bytes as f64 / plate_time_s);
        }
    }

    /// What one may take that lasts so long, bytes.
    pub fn estimate(&self, plate_time_s: f64) -> u64 {
        let mut rates: Vec<f64> = self.0.iter().copied().collect();
        rates.sort_by(f64::total_cmp);
        (plate_time_s * rates.get(rates.len() / 2).copied().unwrap_or(FIRST_RATE)).round() as u64
    }
}

/// What others than the superuser may still write on the disk of `folder`.
fn free_bytes(folder: &Path) -> Option<u64> {
    let disk = rustix::fs::statvfs(folder).ok()?;
    Some(disk.f_bavail.saturating_mul(disk.f_frsize))
}

fn megabytes(bytes: u64) -> String {
    format!("{:.0} MB", bytes as f64 * 1e-6)
}

#[cfg(test)]
mod tests {
    use super::*;

    const MB: u64 = 1_000_000;

    #[test]
    fn recordings_are_expected_to_be_like_those_before() {
        let mut rates = Rates::default();
        assert_eq!(rates.estimate(100.0), 40 * MB);
        rates.add(5 * MB, 0.9);
        assert_eq!(rates.estimate(100.0), 40 * MB, "too short to tell");
        rates.add(2 * MB, 10.0);
        assert_eq!(rates.estimate(100.0), 20 * MB);
        for mb in [100, 1, 1] {
            rates.add(mb * MB, 10.0);
        }
        assert_eq!(rates.estimate(100.0), 20 * MB, "one that is odd does not count");
        for _ in 0..10 {
            rates.add(3 * MB, 10.0);
        }
        assert_eq!((rates.estimate(100.0), rates.0.len()), (30 * MB, 10));
    }

    #[test]
    fn what_must_stay_free_is_no_room() {
        let clock = MonotonicClock::new();
        let disk = Disk::new(Path::new("/no/such/folder"), 500 * MB, &clock);
        let now = clock.elapsed();
        assert_eq!((disk.free_bytes(now), disk.has_room(u64::MAX, now)), (None, Ok(())), "nobody knows");
        disk.saw(Some(600 * MB), now);
        assert_eq!((disk.free_bytes(now), disk.has_room(100 * MB, now)), (Some(600 * MB), Ok(())));
        let told = "it may take 101 MB, the disk has 600 MB left, of which 500 MB stay free";
        assert_eq!(disk.has_room(101 * MB, now), Err(told.to_owned()));
        assert!(disk.has_room(u64::MAX, now).is_err());
    }

    #[test]
    fn a_disk_that_hangs_is_told_once() {
        let clock = MonotonicClock::new();
        let disk = Disk::new(Path::new("/"), 0, &clock);
        disk.saw(Some(MB), Duration::from_secs(10));
        for s in 10..=15 {
            disk.heed(Duration::from_secs(s));
            assert_eq!(disk.free_bytes(Duration::from_secs(s)), Some(MB));
        }
        assert!(!disk.told.load(Ordering::Relaxed));
        disk.heed(Duration::from_millis(15_001));
        assert!(disk.told.load(Ordering::Relaxed));
        assert_eq!(disk.free_bytes(Duration::from_millis(15_001)), None);
        disk.saw(Some(MB), Duration::from_secs(20));
        assert!(!disk.told.load(Ordering::Relaxed));
    }

    #[test]
    fn a_real_disk_says_what_is_free() {
        let folder = tempfile::tempdir().unwrap();
        assert!(free_bytes(folder.path()).is_some_and(|free| free > 0));
    }
}
