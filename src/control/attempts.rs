//! What to try when the wanted steps cannot be made: less of them, then one part at a time.

use upm_core::geometry::Vec2;
use upm_planner::PartState;

/// Parts of the steps that are tried together.
const FRACTIONS: [f64; 4] = [1.0, 0.5, 0.25, 0.125];

/// Steps to try.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Attempt {
    /// The parts with these steps.
    pub parts: Vec<PartState>,
    /// True when only some of what was wanted is tried.
    pub is_part: bool,
}

/// Everything worth trying, best first; no smaller steps of all parts for a planner that tries them itself.
pub(super) fn ways_to_try(whole: &[PartState], tries_smaller: bool) -> impl Iterator<Item = Attempt> + '_ {
    let fractions = if tries_smaller { &FRACTIONS[..1] } else { &FRACTIONS };
    let together = fractions.iter().map(|&part| Attempt {
        parts: whole.iter().map(|state| PartState { step_m: part * state.step_m, ..*state }).collect(),
        is_part: part < 1.0,
    });
    let mut longest_first: Vec<usize> = (0..whole.len()).collect();
    longest_first.sort_by(|&a, &b| whole[b].step_m.norm().total_cmp(&whole[a].step_m.norm()).then(a.cmp(&b)));
    let alone = longest_first.into_iter().map(|moving| {
        let step_m = |part: usize| if part == moving { whole[part].step_m } else { Vec2::zeros() };
        let parts = whole.iter().enumerate().map(|(part, state)| PartState { step_m: step_m(part), ..*state });
        Attempt { parts: parts.collect(), is_part: true }
    });
    let several = whole.len() > 1;
    together.chain(alone.filter(move |_| several))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_together_in_ever_smaller_steps_then_the_farthest_alone() {
        let state =
            |x: f64| PartState { position_m: Vec2::zeros(), step_m: Vec2::new(x, 0.0), radius_m: 0.01, gain: 1.0 };
        let whole = [state(0.002), state(0.008)];
        let tried: Vec<Attempt> = ways_to_try(&whole, false).collect();
        let steps: Vec<[f64; 2]> = tried.iter().map(|a| [a.parts[0].step_m.x, a.parts[1].step_m.x]).collect();
        let expected = [[0.002, 0.008], [0.001, 0.004], [0.0005, 0.002], [0.00025, 0.001], [0.0, 0.008], [0.002, 0.0]];
        assert_eq!(steps, expected);
        assert_eq!(tried.iter().map(|a| a.is_part).collect::<Vec<_>>(), [false, true, true, true, true, true]);
        assert_eq!(ways_to_try(&whole[..1], false).count(), 4, "one part is always alone");
        let steps: Vec<f64> = ways_to_try(&whole, true).map(|a| a.parts[1].step_m.x).collect();
        assert_eq!(steps, [0.008, 0.008, 0.0], "the planner has tried the smaller ones");
    }
}
