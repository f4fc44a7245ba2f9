//! Two 2-axis accelerometers under opposite corners of the plate and their converter (UPM paper, section 3.2).

use rand_distr::{Distribution, StandardNormal};

use super::AccelerometerParams;
use super::plate::PlateMotion;
use upm_core::random::{Rng, Streams};
use upm_core::signal::{AccelTrace, CHANNELS, Envelope};

/// The sensors, with an offset and a gain error per channel, and the trace of the last pulse.
#[derive(Clone, Debug)]
pub(crate) struct Accelerometers {
    params: AccelerometerParams,
    bias_mps2: [f64; CHANNELS],
    gain: [f64; CHANNELS],
    noise: Rng,
    /// Trace of the last pulse.
    trace: AccelTrace,
    /// That of the one before a pulse that took over, and the number of samples for which the latter rises.
    before: Option<(AccelTrace, usize)>,
    /// Start of the trace, s after that of the first pulse of a sequence without pauses.
    from_s: f64,
    /// Samples not yet taken in this pulse.
    pending: usize,
}

impl Accelerometers {
    /// Draws every channel's bias and gain error.
    pub fn new(params: &AccelerometerParams, streams: &Streams) -> Self {
        let mut build = streams.stream("accelerometer build");
        let mut draw = |sd: f64| sd * normal(&mut build);
        let count_limit = ((1u32 << (params.bits.clamp(2, 16) - 1)) - 1) as i16;
        Self {
            params: *params,
            bias_mps2: std::array::from_fn(|_| draw(params.bias_sd_mps2)),
            gain: std::array::from_fn(|_| 1.0 + draw(params.gain_sd)),
            noise: streams.stream("accelerometer noise"),
            trace: AccelTrace {
                sample_hz: params.sample_hz,
                first_sample_s: 0.0,
                mps2_per_count: params.range_mps2 / (f64::from(count_limit) + 1.0),
                count_limit,
                counts: Default::default(),
            },
            before: None,
            from_s: 0.0,
            pending: 0,
        }
    }

    /// Begins a new pulse that is driven for `driven_s`; discards the last trace.
    pub fn start(&mut self, driven_s: f64) {
        (self.before, self.from_s) = (None, 0.0);
        self.begin(driven_s);
    }

    /// Begins a pulse that takes over `from_s` after the first one of its sequence began.
    pub fn take_over(&mut self, from_s: f64, envelope: &Envelope) {
        self.before = Some((self.trace.clone(), (envelope.attack_s * self.params.sample_hz).ceil() as usize));
        self.from_s = from_s;
        self.begin(envelope.driven_s());
    }

    /// Trace of the last pulse; of the one before while the last one rises.
    pub fn trace(&self) -> &AccelTrace {
        self.before.as_ref().filter(|(_, rising)| self.trace.len() < *rising).map_or(&self.trace, |(trace, _)| trace)
    }

    fn begin(&mut self, driven_s: f64) {
        self.pending = (driven_s * self.params.sample_hz).floor() as usize + 1;
        for channel in &mut self.trace.counts {
            channel.clear();
            channel.reserve(self.pending);
        }
    }

    /// Ends the recording of this pulse.
    pub fn stop(&mut self) {
        self.pending = 0;
    }

    /// Takes the samples due between `from_s` and `to_s` after the pulse's start, when the plate moved as `from` and
    /// `to`; acceleration is interpolated linearly between the two instants.
    #[inline(always)]
    pub fn observe(&mut self, from_s: f64, from: &PlateMotion, to_s: f64, to: &PlateMotion) {
        const ROUNDING: f64 = 1e-9;
        while self.pending > 0 {
            let due_s = self.from_s + self.trace.len() as f64 / self.params.sample_hz;
            if due_s > to_s + ROUNDING {
                return;
            }
            let along = ((due_s - from_s) / (to_s - from_s)).clamp(0.0, 1.0);
            self.sample(from, to, along);
            self.pending -= 1;
        }
    }

    #[inline(always)]
    fn sample(&mut self, from: &PlateMotion, to: &PlateMotion, along: f64) {
        let place = self.params.position_m;
        let felt = [place, -place].map(|p| from.proper_acceleration_at(p).lerp(&to.proper_acceleration_at(p), along));
        let limit = f64::from(self.trace.count_limit);
        for (channel, (counts, felt_mps2)) in
            self.trace.counts.iter_mut().zip([felt[0].x, felt[0].y, felt[1].x, felt[1].y]).enumerate()
        {
            let noise = self.params.noise_mps2 * normal(&mut self.noise);
            let shown = self.gain[channel] * felt_mps2 + self.bias_mps2[channel] + noise;
            counts.push((shown / self.trace.mps2_per_count).round().max(-limit).min(limit) as i16);
        }
    }
}

fn normal(rng: &mut Rng) -> f64 {
    StandardNormal.sample(rng)
}

#[cfg(test)]
mod tests {
    use super::*;
    use upm_core::geometry::{Twist, Vec2};

    const PARAMS: AccelerometerParams = AccelerometerParams {
        position_m: Vec2::new(0.09, -0.09),
        sample_hz: 5000.0,
        bits: 11,
        range_mps2: 40.0,
        noise_mps2: 0.0,
        bias_sd_mps2: 0.0,
        gain_sd: 0.0,
    };

    fn accelerated(x: f64, y: f64, spin: f64) -> PlateMotion {
        PlateMotion { acceleration: Twist::new(x, y, spin), ..Default::default() }
    }

    /// A whole trace of an acceleration that grows by 10 m/s² and 10 rad/s² per second.
    fn ramp(params: &AccelerometerParams, step_s: f64, length_s: f64) -> AccelTrace {
        let mut sensors = Accelerometers::new(params, &Streams::new(3));
        sensors.start(length_s);
        for i in 0..(length_s / step_s).ceil() as usize + 5 {
            let (from, to) = (i as f64 * step_s, (i + 1) as f64 * step_s);
            let at = |t: f64| accelerated(10.0 * t, 0.0, 10.0 * t);
            sensors.observe(from, &at(from), to, &at(to));
        }
        sensors.trace.clone()
    }

    #[test]
    fn samples_are_taken_at_their_instants_for_any_step() {
        for step_s in [5e-5, 7e-5, 3.3e-4] {
            let trace = ramp(&PARAMS, step_s, 0.8);
            assert_eq!(trace.len(), 4001);
            for i in [0, 1, 777, 4000] {
                let t = trace.time_s(i);
                // corner 1: x = a - spin' y, y = spin' x; corner 2 opposite
                let expected = [10.0 * t * 1.09, 0.9 * t, 10.0 * t * 0.91, -0.9 * t];
                for (channel, expected) in trace.counts.iter().zip(expected) {
                    let shown = f64::from(channel[i]) * trace.mps2_per_count;
                    assert!((shown - expected).abs() <= 0.5001 * trace.mps2_per_count, "{shown} {expected}");
                }
            }
        }
    }

    #[test]
    fn converter_clips_and_counts_in_its_bits() {
        let trace = ramp(&PARAMS, 1e-3, 5.0);
        assert_eq!((trace.count_limit, trace.mps2_per_count), (1023, 40.0 / 1024.0));
        assert_eq!(trace.counts[0].last(), Some(&1023));
    }

    #[test]
    fn every_channel_has_its_own_bias_gain_and_noise() {
        let real = AccelerometerParams { noise_mps2: 0.2, bias_sd_mps2: 1.0, gain_sd: 0.05, ..PARAMS };
        let mut sensors = Accelerometers::new(&real, &Streams::new(3));
        assert!(sensors.bias_mps2.windows(2).all(|b| b[0] != b[1]));
        assert!(sensors.gain.windows(2).all(|g| g[0] != g[1]));
        sensors.start(2.0);
        sensors.observe(0.0, &accelerated(10.0, 0.0, 0.0), 2.0, &accelerated(10.0, 0.0, 0.0));
        let trace = sensors.trace;
        let shown: Vec<f64> = trace.counts[0].iter().map(|&c| f64::from(c) * trace.mps2_per_count).collect();
        let mean = shown.iter().sum::<f64>() / shown.len() as f64;
        let sd = (shown.iter().map(|s| (s - mean).powi(2)).sum::<f64>() / shown.len() as f64).sqrt();
        assert!((mean - (10.0 * sensors.gain[0] + sensors.bias_mps2[0])).abs() < 0.01);
        assert!((sd - 0.2).abs() < 0.01, "{sd}");
    }
}
