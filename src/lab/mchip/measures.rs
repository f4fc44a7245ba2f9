//! Figures of a run: rates and stalls, height, energies, inter-arrival times, spectrum.

use super::run::{Impact, Run, Sample};
use upm_core::units::GRAVITY_MPS2;
use upm_perception::estimation::amplitude_spectrum;

/// Length of the windows in which a part moves or stalls, s: half of the strobing period of a row.
const RATE_WINDOW_S: f64 = 0.02;
/// Rate below which a part stalls, m/s.
const STALL_MPS: f64 = 0.15e-3;
/// Impacts of one resonator within this time of each other are one contact, s.
const ONE_CONTACT_S: f64 = 8e-6;

/// Samples of `run` from `from_s` on.
pub fn samples_from(run: &Run, from_s: f64) -> &[Sample] {
    &run.samples[run.samples.partition_point(|sample| sample.at_s < from_s)..]
}

/// Rate over all of `samples`, m/s.
pub fn mean_rate_mps(samples: &[Sample]) -> f64 {
    match samples {
        [first, .., last] => (last.state.center_m.x - first.state.center_m.x) / (last.at_s - first.at_s),
        _ => f64::NAN,
    }
}

/// Feed of a part: its rate while it moves, and its stalls.
#[derive(Clone, Debug, PartialEq)]
pub struct FeedMeasure {
    /// Median rate of the windows in which the part moves, m/s.
    pub moving_mps: f64,
    pub longest_stall_s: f64,
}

impl FeedMeasure {
    pub fn of(samples: &[Sample]) -> Self {
        let Some(stride) = samples.windows(2).next().map(|pair| pair[1].at_s - pair[0].at_s) else {
            return Self { moving_mps: f64::NAN, longest_stall_s: 0.0 };
        };
        let window = (RATE_WINDOW_S / stride).round() as usize;
        let (mut moving, mut stall_s, mut longest_stall_s) = (Vec::new(), 0.0, 0.0f64);
        for samples in samples.windows(window + 1).step_by(window) {
            let rate_mps = mean_rate_mps(samples);
            if rate_mps < STALL_MPS {
                stall_s += RATE_WINDOW_S;
            } else {
                stall_s = 0.0;
                moving.push(rate_mps);
            }
            longest_stall_s = longest_stall_s.max(stall_s);
        }
        Self { moving_mps: median(moving), longest_stall_s }
    }
}

/// Median of numbers; NaN for none.
pub fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

/// Mean and standard deviation of a quantity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spread {
    pub mean: f64,
    pub sd: f64,
}

impl Spread {
    pub fn of(values: impl Iterator<Item = f64> + Clone) -> Self {
        let count = values.clone().count().max(1) as f64;
        let mean = values.clone().sum::<f64>() / count;
        Self { mean, sd: (values.map(|value| (value - mean).powi(2)).sum::<f64>() / count).sqrt() }
    }
}

/// Energies of a part (Table I, right), J. LinX is that of the motion relative to the drift.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Energies {
    /// LinX without the drift, LinY, LinZ, AngX, AngY, AngZ, and PotZ relative to rest.
    pub each: [Spread; 7],
    /// Kinetic energy of the drift along x, J.
    pub drift_j: f64,
}

impl Energies {
    pub fn of(run: &Run, samples: &[Sample]) -> Self {
        let part = &run.setup.part;
        let drift_mps = mean_rate_mps(samples);
        let weight_n = part.mass_kg * GRAVITY_MPS2;
        let energies_j = |sample: &Sample| {
            let mut state = sample.state;
            state.velocity_mps.x -= drift_mps;
            let [a, b, c, d, e, f] = part.kinetic_j(&state);
            [a, b, c, d, e, f, weight_n * run.height_m(&state)]
        };
        Self {
            each: std::array::from_fn(|i| Spread::of(samples.iter().map(|sample| energies_j(sample)[i]))),
            drift_j: 0.5 * part.mass_kg * drift_mps.powi(2),
        }
    }
}

/// One contact of a resonator and the time since its last one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Arrival {
    /// Time since the previous contact, s.
    pub gap_s: f64,
    pub angle_rad: f64,
    pub speed_radps: f64,
    /// Impulse on the part along the feed, N s.
    pub forward_ns: f64,
}

/// Contacts of driven resonators from `from_s` to `until_s`, each with the time since the previous one of the same
/// resonator. Impacts within 8 µs are one contact with the state of the first and the sum of their impulses.
pub fn arrivals(impacts: &[Impact], from_s: f64, until_s: f64) -> Vec<Arrival> {
    let mut of_resonator = std::collections::BTreeMap::<usize, Vec<&Impact>>::new();
    for impact in impacts.iter().filter(|impact| (from_s..until_s).contains(&impact.at_s)) {
        of_resonator.entry(impact.resonator).or_default().push(impact);
    }
    let mut arrivals = Vec::new();
    for impacts in of_resonator.values() {
        let mut last: Option<(f64, f64)> = None;
        for impact in impacts {
            if let Some((_, latest_s)) = &mut last
                && impact.at_s - *latest_s < ONE_CONTACT_S
            {
                *latest_s = impact.at_s;
                if let Some(Arrival { forward_ns, .. }) = arrivals.last_mut() {
                    *forward_ns += impact.impulse_ns.x;
                }
                continue;
            }
            let gap_s = last.map_or(f64::INFINITY, |(start_s, _)| impact.at_s - start_s);
            last = Some((impact.at_s, impact.at_s));
            arrivals.push(Arrival {
                gap_s: if impact.driven { gap_s } else { f64::INFINITY },
                angle_rad: impact.swing.angle_rad,
                speed_radps: impact.swing.speed_radps,
                forward_ns: impact.impulse_ns.x,
            });
        }
    }
    arrivals.retain(|arrival| arrival.gap_s.is_finite());
    arrivals
}

/// Contacts with similar gaps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cluster {
    /// Share of all contacts.
    pub share: f64,
    /// Median gap, s.
    pub gap_s: f64,
    pub angle_rad: f64,
    pub speed_radps: f64,
    /// Share of the cluster's contacts that push backwards.
    pub backward: f64,
}

/// Double bounces, the bounces that follow them, and bounces once a cycle: gaps of up to 0.3, 0.7 to 0.94 and 0.94 to
/// 1.06 drive cycles.
pub fn clusters(arrivals: &[Arrival], drive_hz: f64) -> [Cluster; 3] {
    [[0.0, 0.3], [0.7, 0.94], [0.94, 1.06]].map(|[from, to]| {
        let inside: Vec<&Arrival> =
            arrivals.iter().filter(|arrival| (from..to).contains(&(arrival.gap_s * drive_hz))).collect();
        let count = inside.len().max(1) as f64;
        let mean = |of: &dyn Fn(&Arrival) -> f64| inside.iter().map(|arrival| of(arrival)).sum::<f64>() / count;
        Cluster {
            share: inside.len() as f64 / arrivals.len().max(1) as f64,
            gap_s: median(inside.iter().map(|arrival| arrival.gap_s).collect()),
            angle_rad: mean(&|arrival| arrival.angle_rad),
            speed_radps: mean(&|arrival| arrival.speed_radps),
            backward: mean(&|arrival| f64::from(u8::from(arrival.forward_ns < 0.0))),
        }
    })
}

/// Amplitudes of a uniformly sampled signal without its mean, with a Hann window: frequency in Hz and amplitude.
pub fn spectrum(values: &[f64], stride_s: f64) -> Vec<[f64; 2]> {
    let count = values.len();
    if count == 0 {
        return Vec::new();
    }
    let mean = values.iter().sum::<f64>() / count as f64;
    let window = |i: usize| 1.0 - (std::f64::consts::TAU * i as f64 / count as f64).cos();
    let windowed: Vec<f64> = values.iter().enumerate().map(|(i, value)| (value - mean) * window(i)).collect();
    let lines = amplitude_spectrum(&windowed).into_iter().take(count / 2).enumerate();
    lines.map(|(k, line)| [k as f64 / (count as f64 * stride_s), line.norm()]).collect()
}

/// The largest line of `spectrum` from `from_hz` to `to_hz`.
pub fn strongest_line(spectrum: &[[f64; 2]], from_hz: f64, to_hz: f64) -> [f64; 2] {
    let inside = spectrum.iter().filter(|line| (from_hz..to_hz).contains(&line[0]));
    inside.fold([f64::NAN, 0.0], |best, line| if line[1] > best[1] { *line } else { best })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spectrum_finds_a_line_and_its_amplitude() {
        let values: Vec<f64> =
            (0..5_000).map(|i| 3.0 + 0.7 * (std::f64::consts::TAU * 360.0 * 2e-5 * f64::from(i)).sin()).collect();
        let [hz, amplitude] = strongest_line(&spectrum(&values, 2e-5), 100.0, 2_000.0);
        assert!((hz - 360.0).abs() < 1e-6 && (amplitude - 0.7).abs() < 1e-3, "{hz} {amplitude}");
    }
}
