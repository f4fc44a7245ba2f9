use super::{CalibrationFault, ChannelFault};
use upm_core::geometry::Vec2;
use upm_core::signal::CHANNELS;
use upm_perception::estimation::{Coefficients, check_channels};

/// A channel that shows less of the strongest one than this is dead: every channel sees one whole axis at least.
const DEAD: f64 = 0.1;
/// Least and most that a channel may show for the others' 1.
const GAIN: (f64, f64) = (0.8, 1.25);
/// Part of the readings that may not be those of a rigid plate.
const MISFIT: f64 = 0.05;

/// Refuses the first channel that one pulse of x, y and spin each shows dead, reversed or off.
pub(super) fn check(
    shown: &[[Coefficients; CHANNELS]],
    accelerometer_in_plate_m: Vec2,
) -> Result<(), CalibrationFault> {
    let found = check_channels(shown, accelerometer_in_plate_m);
    let fault = |channel, fault| Err(CalibrationFault::Channel { channel, fault });
    if let Some((channel, share)) = worst(found.share, |share| share < DEAD, |share| -share) {
        return fault(channel, ChannelFault::Dead { share });
    }
    if found.misfit > MISFIT {
        return Err(CalibrationFault::NotRigid { misfit: found.misfit });
    }
    let plausible = |gain: f64| (GAIN.0..=GAIN.1).contains(&gain);
    let Some((channel, gain)) = worst(found.gain, |gain| !plausible(gain), |gain| (gain - 1.0).abs()) else {
        return Ok(());
    };
    fault(channel, if gain < 0.0 { ChannelFault::Reversed { gain } } else { ChannelFault::Gain { gain } })
}

/// Index and value of the worst of those that are `bad`.
fn worst(values: [f64; CHANNELS], bad: impl Fn(f64) -> bool, how: impl Fn(f64) -> f64) -> Option<(usize, f64)> {
    values.into_iter().enumerate().filter(|(_, value)| bad(*value)).max_by(|a, b| how(a.1).total_cmp(&how(b.1)))
}
