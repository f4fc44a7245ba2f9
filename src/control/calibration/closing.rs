use super::axes::Axes;
use super::axis_pulse::{AxisPulse, NAMES};
use super::coils::CoilGains;
use super::{CalibrationError, CalibrationSession, RigComponent};
use upm_core::signal::CHANNELS;
use upm_perception::estimation::Coefficients;

/// Largest change of a reading between the opening and the closing pulse, relative. Noise causes 0.001 and coins at
/// other places up to 0.01; a coil or a channel that lost a tenth of its gain exceeds it.
const ALLOWED: f64 = 0.03;

/// Plays the opening pulses again and refuses a rig that has changed since.
pub(super) fn check(session: &mut CalibrationSession<'_>, axes: &Axes) -> Result<(), CalibrationError> {
    let mut closing: [AxisPulse; 3] = Default::default();
    for (axis, opening) in axes.opening.iter().enumerate() {
        session.report("closing", axis, closing.len());
        closing[axis] = AxisPulse::play(session, axis, opening.drive.clone())?.0;
    }
    let changes = [0, 1, 2].map(|axis| relative_change(&axes.opening[axis].shown, &closing[axis].shown));
    let worst = changes.into_iter().enumerate().max_by(|a, b| a.1.total_cmp(&b.1));
    let Some((axis, change)) = worst.filter(|(_, change)| *change > ALLOWED) else { return Ok(()) };
    let (component, change) = channel(&axes.opening, &closing)
        .map(|(channel, change)| (RigComponent::Channel(channel), change))
        .or_else(|| coil(session, &axes.opening, &closing))
        .unwrap_or((RigComponent::Axis(NAMES[axis]), change));
    Err(CalibrationError::Changed { component, change, allowed: ALLOWED })
}

/// The channel that changed and its relative change, if it is the only one.
fn channel(opening: &[AxisPulse; 3], closing: &[AxisPulse; 3]) -> Option<(usize, f64)> {
    let all = |pulses: &[AxisPulse; 3], channel: usize| pulses.each_ref().map(|pulse| pulse.shown[channel]);
    let change = |channel: usize| relative_change(&all(opening, channel), &all(closing, channel));
    let mut changed = (0..CHANNELS).map(|channel| (channel, change(channel))).filter(|(_, change)| *change > ALLOWED);
    let found = changed.next();
    found.filter(|_| changed.next().is_none())
}

/// The coil that changed and its relative change, if it is the only one.
fn coil(
    session: &CalibrationSession<'_>,
    opening: &[AxisPulse; 3],
    closing: &[AxisPulse; 3],
) -> Option<(RigComponent, f64)> {
    let [before, now] = [opening, closing].map(|pulses| CoilGains::read(pulses, &session.sensors, session.model));
    now[1].changed_since(&before[1], ALLOWED).map(|(coil, change)| (RigComponent::Coil(coil), change))
}

fn relative_change(before: &[Coefficients], now: &[Coefficients]) -> f64 {
    let (before, now) = (before.as_flattened(), now.as_flattened());
    let distance = before.iter().zip(now).map(|(before, now)| (before - now).powi(2)).sum::<f64>().sqrt();
    distance / before.iter().map(|c| c * c).sum::<f64>().sqrt().max(f64::MIN_POSITIVE)
}
