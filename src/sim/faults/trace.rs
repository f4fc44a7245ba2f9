//! Faults between the accelerometers and the computer.

use rand_pcg::rand_core::Rng as _;

use super::{FaultKind, FaultSpec};
use upm_core::random::Rng;
use upm_core::signal::AccelTrace;
use upm_core::time::PlateTime;

/// Applies `fault` to the samples of `channel` in its time span; the pulse began at `started_at`.
pub(super) fn apply_fault(
    trace: &mut AccelTrace,
    fault: &FaultSpec,
    channel: usize,
    started_at: PlateTime,
    noise: &mut Rng,
) {
    let holds = |i: usize| fault.holds(started_at + trace.time_s(i).max(0.0));
    let first = (0..trace.len()).find(|&i| holds(i));
    let Some(first) = first else { return };
    let last = (first..trace.len()).rev().find(|&i| holds(i)).unwrap_or(first);
    let (limit, per_count) = (trace.count_limit, trace.mps2_per_count);
    let Some(counts) = trace.counts.get_mut(channel) else { return };
    let before = counts.clone();
    let stays = before.get(first.saturating_sub(1)).copied().unwrap_or_default();
    let scaled =
        |count: i16, by: f64| (f64::from(count) * by).round().clamp(-f64::from(limit), f64::from(limit)) as i16;
    let lag = fault.values[0] as usize;
    let clip = (fault.values[0] / per_count).min(f64::from(limit));
    for i in first..=last.min(counts.len().saturating_sub(1)) {
        counts[i] = match fault.kind {
            FaultKind::Dead => 0,
            FaultKind::Stuck => stays,
            FaultKind::Garbage => scaled(limit, (noise.next_u64() >> 11) as f64 * 2f64.powi(-52) - 1.0),
            FaultKind::Flip => scaled(before[i], -1.0),
            FaultKind::Gain => scaled(before[i], fault.values[0]),
            FaultKind::Clipped => f64::from(before[i]).clamp(-clip, clip) as i16,
            FaultKind::Late => before[i.saturating_sub(lag)],
            _ => before[i],
        };
    }
}

#[cfg(test)]
mod tests {
    use super::super::FaultyComponent;
    use super::*;
    use upm_core::random::Streams;

    fn altered(kind: FaultKind, value: f64) -> Vec<i16> {
        let ramp: Vec<i16> = (0..10).map(|i| 10 * i).collect();
        let mut trace = AccelTrace {
            sample_hz: 10.0,
            first_sample_s: 0.0,
            mps2_per_count: 0.1,
            count_limit: 1000,
            counts: [ramp.clone(), ramp.clone(), ramp.clone(), ramp],
        };
        let (from, to) = (PlateTime::from_secs(5.2), Some(PlateTime::from_secs(5.5)));
        let fault =
            FaultSpec { component: FaultyComponent::Accelerometer(1), kind, values: [value, 0.0, 0.0], from, to };
        apply_fault(&mut trace, &fault, 1, PlateTime::from_secs(5.0), &mut Streams::new(1).stream("faults"));
        assert_eq!(trace.counts[0], trace.counts[2], "other channels stay");
        trace.counts[1].clone()
    }

    #[test]
    fn channel_is_spoilt_while_the_fault_holds() {
        let with = |middle: [i16; 3]| [vec![0, 10], middle.to_vec(), vec![50, 60, 70, 80, 90]].concat();
        assert_eq!(altered(FaultKind::Dead, 0.0), with([0, 0, 0]));
        assert_eq!(altered(FaultKind::Stuck, 0.0), with([10, 10, 10]));
        assert_eq!(altered(FaultKind::Flip, 0.0), with([-20, -30, -40]));
        assert_eq!(altered(FaultKind::Gain, 0.5), with([10, 15, 20]));
        assert_eq!(altered(FaultKind::Clipped, 3.0), with([20, 30, 30]));
        assert_eq!(altered(FaultKind::Late, 2.0), with([0, 10, 20]));
        assert_ne!(altered(FaultKind::Garbage, 0.0), with([20, 30, 40]));
    }
}
