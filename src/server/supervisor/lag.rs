use std::time::Duration;

/// Length of a window over which the lag is measured.
const WINDOW: Duration = Duration::from_secs(5);
/// Growth of the lag within a window above which the computer is too slow.
const TOLERATED: Duration = Duration::from_millis(100);

/// Detects whether plate time currently falls behind the clock, window by window.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Lag {
    /// Start of the current window, and the lag at that time.
    window: Option<(Duration, Duration)>,
    grows: bool,
}

impl Lag {
    /// Adds the lag `behind` at time `now`; true while the lag grew too much in the last complete window.
    pub fn grows(&mut self, now: Duration, behind: Duration) -> bool {
        let (began, before) = *self.window.get_or_insert((now, behind));
        if now.saturating_sub(began) >= WINDOW {
            self.grows = behind.saturating_sub(before) > TOLERATED;
            self.window = Some((now, behind));
        }
        self.grows
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lag_is_reported_only_while_it_grows() {
        let mut lag = Lag::default();
        let mut reported = Vec::new();
        for tenths in 0..250_u64 {
            let now = Duration::from_millis(100 * tenths);
            // 10 ms lost per frame from 5 to 12 s
            let behind = Duration::from_millis(10 * tenths.clamp(50, 120));
            reported.push(lag.grows(now, behind));
        }
        let first = reported.iter().position(|grows| *grows);
        assert_eq!((first, reported.iter().rposition(|grows| *grows)), (Some(100), Some(199)));
    }

    #[test]
    fn one_short_stall_is_not_reported_as_lag() {
        let mut lag = Lag::default();
        let behind = |tenths: u64| Duration::from_millis(if tenths > 30 { 90 } else { 0 });
        assert!((0..200).all(|tenths| !lag.grows(Duration::from_millis(100 * tenths), behind(tenths))));
    }
}
