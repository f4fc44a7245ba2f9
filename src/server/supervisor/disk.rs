//! Keeps recordings from filling the disk: a recording that might fill it is not begun, and those under way are stopped
//! when space runs low. The plates go on.

use std::collections::{BTreeMap, VecDeque};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread;
use std::time::Duration;

use parking_lot::{Mutex, MutexGuard};

use super::shared::PlateInner;
use super::watchdog::ms;
use crate::store::JobId;
use upm_core::files::free_bytes;
use upm_core::time::{Clock, MonotonicClock};
use upm_recording::{RecordingHandle, RecordingState};

/// Interval between two measurements of free space.
const APART: Duration = Duration::from_secs(1);
/// Time for which a measurement is valid. One that takes longer hangs.
const STALL_LIMIT: Duration = Duration::from_secs(5);
/// Estimated bytes per second of plate time of a recording, before any was made. Recordings of the plus sign take 0.1
/// MB/s, those of eight coins 0.2 MB/s; this is twice as much.
const FIRST_RATE: f64 = 0.4e6;
/// Newest recordings from which the next one's size is estimated.
const RATES: usize = 10;
/// Shortest recording that counts, s: a shorter one is mostly the header that every recording has.
const SHORTEST_S: f64 = 1.0;
const UNKNOWN: u64 = u64::MAX;

/// Free space on the disk, and the space reserved for recordings.
#[derive(Debug)]
pub(super) struct DiskSpace {
    min_free_bytes: u64,
    /// Free bytes at the last measurement; [`UNKNOWN`] when the disk did not respond.
    free_bytes: AtomicU64,
    looked_ms: AtomicU64,
    /// True once it was logged that the disk does not respond.
    reported: AtomicBool,
    ending: AtomicBool,
    /// Recordings of running jobs with the bytes reserved for each.
    reserved: Mutex<BTreeMap<JobId, (RecordingHandle, u64)>>,
}

impl DiskSpace {
    /// The state of the disk that holds `folder`, measured once.
    pub fn new(folder: &Path, min_free_bytes: u64, clock: &MonotonicClock) -> Self {
        Self {
            min_free_bytes,
            free_bytes: AtomicU64::new(free_bytes(folder).ok().unwrap_or(UNKNOWN)),
            looked_ms: AtomicU64::new(ms(clock.elapsed())),
            reported: AtomicBool::new(false),
            ending: AtomicBool::new(false),
            reserved: Mutex::default(),
        }
    }

    /// Free bytes; `None` when the disk does not respond.
    pub fn free_bytes(&self, now: Duration) -> Option<u64> {
        let free = self.free_bytes.load(Ordering::Relaxed);
        (free != UNKNOWN && !self.hangs(now)).then_some(free)
    }

    /// The reason to begin nothing that can wait: less is free than is to stay free. `None` with enough free.
    pub fn is_low(&self, now: Duration) -> Option<String> {
        let free = self.free_bytes(now).filter(|&free| free < self.min_free_bytes)?;
        Some(format!("the disk has only {} left", megabytes(free)))
    }

    /// Reserves `wanted_bytes` for the recording of a job, until [`Self::release`]. `Err` says why not; it counts the
    /// bytes that other recordings may still take. A disk that does not respond is assumed to have room.
    pub fn reserve(
        &self,
        job: JobId,
        recording: &RecordingHandle,
        wanted_bytes: u64,
        now: Duration,
    ) -> Result<(), String> {
        let mut reserved = self.reserved();
        let others = reserved.values().map(|(recording, bytes)| still_to_come(&recording.state(), *bytes));
        let others_bytes = others.fold(0, u64::saturating_add);
        let taken_bytes = wanted_bytes.saturating_add(others_bytes).saturating_add(self.min_free_bytes);
        if let Some(free) = self.free_bytes(now).filter(|&free| free < taken_bytes) {
            let [wanted, others, free, kept] = [wanted_bytes, others_bytes, free, self.min_free_bytes].map(megabytes);
            let others = if others_bytes > 0 { format!(", other recordings {others} more") } else { String::new() };
            return Err(format!("it may take {wanted}{others}; the disk has {free} left, of which {kept} stay free"));
        }
        reserved.insert(job, (recording.clone(), wanted_bytes));
        Ok(())
    }

    /// Ends the reservation of the recording of this job.
    pub fn release(&self, job: &JobId) {
        self.reserved().remove(job);
    }

    fn reserved(&self) -> MutexGuard<'_, BTreeMap<JobId, (RecordingHandle, u64)>> {
        self.reserved.lock()
    }

    /// Logs once that the disk does not respond.
    pub fn log_stall(&self, now: Duration) {
        if self.hangs(now) && !self.reported.swap(true, Ordering::Relaxed) {
            tracing::error!("the disk does not respond ({} s)", STALL_LIMIT.as_secs());
        }
    }

    fn hangs(&self, now: Duration) -> bool {
        now.saturating_sub(Duration::from_millis(self.looked_ms.load(Ordering::Relaxed))) > STALL_LIMIT
    }

    fn saw(&self, free: Option<u64>, now: Duration) {
        self.free_bytes.store(free.unwrap_or(UNKNOWN), Ordering::Relaxed);
        self.looked_ms.store(ms(now), Ordering::Relaxed);
        if self.reported.swap(false, Ordering::Relaxed) {
            tracing::info!("the disk answers again");
        }
    }

    /// Ends the measurements.
    pub fn end(&self) {
        self.ending.store(true, Ordering::Relaxed);
    }
}

/// Polls free space on its own thread, because `statvfs` on a hung disk can block forever.
pub(super) struct DiskGuard {
    pub disk: Arc<DiskSpace>,
    pub folder: PathBuf,
    pub plates: Vec<Arc<PlateInner>>,
    pub clock: MonotonicClock,
}

impl DiskGuard {
    /// Polls until [`DiskSpace::end`].
    pub fn run(self) {
        while !self.disk.ending.load(Ordering::Relaxed) {
            self.saw(free_bytes(&self.folder).ok());
            thread::park_timeout(APART);
        }
    }

    /// Takes a measurement; stops every recording when too little is free.
    pub fn saw(&self, free: Option<u64>) {
        self.disk.saw(free, self.clock.elapsed());
        let low = free.filter(|&free| free < self.disk.min_free_bytes);
        let Some(free) = low else { return };
        let reason = format!("the disk has only {} left", megabytes(free));
        for recording in self.plates.iter().filter_map(|plate| plate.job.recording()) {
            recording.stop(&reason);
        }
    }
}

/// Sizes of the newest recordings of a plate, bytes per second of plate time.
#[derive(Debug, Default)]
pub(super) struct Rates(VecDeque<f64>);

impl Rates {
    /// Adds a complete recording of this size and length, s.
    pub fn add(&mut self, bytes: u64, plate_time_s: f64) {
        if plate_time_s >= SHORTEST_S {
            self.0.truncate(RATES - 1);
            self.0.push_front(bytes as f64 / plate_time_s);
        }
    }

    /// Estimated size of a recording of this length, bytes.
    pub fn estimate(&self, plate_time_s: f64) -> u64 {
        let mut rates: Vec<f64> = self.0.iter().copied().collect();
        rates.sort_by(f64::total_cmp);
        (plate_time_s * rates.get(rates.len() / 2).copied().unwrap_or(FIRST_RATE)).round() as u64
    }
}

/// Bytes that a recording may still take of those reserved.
fn still_to_come(state: &RecordingState, promised_bytes: u64) -> u64 {
    match state {
        RecordingState::Off => promised_bytes,
        RecordingState::Writing { bytes } => promised_bytes.saturating_sub(*bytes),
        RecordingState::Stopped(_) | RecordingState::Failed(_) | RecordingState::Whole => 0,
    }
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
    fn space_that_must_stay_free_is_not_reserved() {
        let clock = MonotonicClock::new();
        let disk = DiskSpace::new(Path::new("/no/such/folder"), 500 * MB, &clock);
        let now = clock.elapsed();
        let job = |number: u8| JobId::parse(&format!("{number:032x}")).unwrap();
        let reserve = |number, bytes| disk.reserve(job(number), &RecordingHandle::default(), bytes, now);
        assert_eq!((disk.free_bytes(now), reserve(0, u64::MAX)), (None, Ok(())), "nobody knows");
        disk.release(&job(0));
        disk.saw(Some(600 * MB), now);
        assert_eq!((disk.free_bytes(now), reserve(1, 100 * MB)), (Some(600 * MB), Ok(())));
        disk.release(&job(1));
        let refusal = "it may take 101 MB; the disk has 600 MB left, of which 500 MB stay free";
        assert_eq!(reserve(1, 101 * MB), Err(refusal.to_owned()));
        assert!(reserve(1, u64::MAX).is_err());
    }

    #[test]
    fn recordings_at_the_same_time_share_the_room() {
        let clock = MonotonicClock::new();
        let (disk, now) = (DiskSpace::new(Path::new("/"), 500 * MB, &clock), clock.elapsed());
        let job = |number: u8| JobId::parse(&format!("{number:032x}")).unwrap();
        let (first, second) = (RecordingHandle::default(), RecordingHandle::default());
        disk.saw(Some(600 * MB), now);
        assert_eq!(disk.reserve(job(1), &first, 70 * MB, now), Ok(()));
        let refusal =
            "it may take 40 MB, other recordings 70 MB more; the disk has 600 MB left, of which 500 MB stay free";
        assert_eq!(disk.reserve(job(2), &second, 40 * MB, now), Err(refusal.to_owned()));
        assert_eq!(disk.reserve(job(2), &second, 30 * MB, now), Ok(()));
        disk.release(&job(1));
        assert_eq!(disk.reserve(job(1), &first, 70 * MB, now), Ok(()));
        disk.release(&job(1));
        disk.release(&job(2));
        assert!(disk.reserved().is_empty());
    }

    #[test]
    fn written_bytes_are_no_longer_expected() {
        assert_eq!(still_to_come(&RecordingState::Off, 70), 70);
        assert_eq!(still_to_come(&RecordingState::Writing { bytes: 50 }, 70), 20);
        assert_eq!(still_to_come(&RecordingState::Writing { bytes: 80 }, 70), 0);
        let ended = [RecordingState::Whole, RecordingState::Failed("".into()), RecordingState::Stopped("".into())];
        assert!(ended.iter().all(|state| still_to_come(state, 70) == 0));
    }

    #[test]
    fn hung_disk_is_reported_once() {
        let clock = MonotonicClock::new();
        let disk = DiskSpace::new(Path::new("/"), 0, &clock);
        disk.saw(Some(MB), Duration::from_secs(10));
        for s in 10..=15 {
            disk.log_stall(Duration::from_secs(s));
            assert_eq!(disk.free_bytes(Duration::from_secs(s)), Some(MB));
        }
        assert!(!disk.reported.load(Ordering::Relaxed));
        disk.log_stall(Duration::from_millis(15_001));
        assert!(disk.reported.load(Ordering::Relaxed));
        assert_eq!(disk.free_bytes(Duration::from_millis(15_001)), None);
        disk.saw(Some(MB), Duration::from_secs(20));
        assert!(!disk.reported.load(Ordering::Relaxed));
    }

    #[test]
    fn free_space_of_a_real_disk_is_read() {
        let folder = tempfile::tempdir().unwrap();
        assert!(free_bytes(folder.path()).is_ok_and(|free| free > 0));
    }
}
