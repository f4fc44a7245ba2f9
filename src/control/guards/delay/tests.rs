use super::*;
use upm_core::geometry::Twist;
use upm_core::signal::TwistHarmonic;

const FRAME_HZ: f64 = 60.0;
const LIMIT: f64 = 20.0;
const FRAME_S: f64 = 1.0 / FRAME_HZ;

/// A pulse of a rotation or of a synthesised motion, `sustain_s` at full height.
fn swing(speed_mps: f64, base_hz: f64, attack_s: f64, sustain_s: f64) -> PlateSwing {
    let harmonic = |share: f64| TwistHarmonic {
        cos: Twist::new(speed_mps, 0.0, speed_mps) * share,
        sin: Twist::new(0.0, speed_mps, 0.0) * share,
    };
    PlateSwing {
        fades: None,
        wave: TwistWave { base_radps: std::f64::consts::TAU * base_hz, harmonics: vec![harmonic(1.0), harmonic(0.6)] },
        envelope: Envelope { attack_s, sustain_s, rest_s: 0.04 },
        half_side_m: 0.15,
        px_per_m: 2900.0,
    }
}

/// Number of frames from one pulse to the next.
fn frames(swing: &PlateSwing) -> u32 {
    (swing.envelope.total_s() / FRAME_S).ceil() as u32 + 1
}

/// Findings in four consecutive pulses of `swing`, in frames that are `late` frames late.
fn found(late: u32, swing: &PlateSwing) -> [Option<usize>; 4] {
    let frames = frames(swing);
    let mut guard = DelayGuard::new(FRAME_HZ, LIMIT);
    let begin_s = |number: u32| f64::from(3 + number * frames) * FRAME_S + 0.001;
    let seen_px = |at_s: f64| {
        let pulse = (0..4).rev().map(begin_s).find(|begin_s| *begin_s <= at_s);
        pulse.map_or(Vector3::zeros(), |begin_s| swing.at_px(at_s - begin_s)).add_scalar(0.02)
    };
    [0, 1, 2, 3].map(|number| {
        guard.begin(begin_s(number), swing.clone());
        for frame in 4 + number * frames..4 + (number + 1) * frames {
            let at_s = f64::from(frame) * FRAME_S;
            guard.frame(at_s, Some(seen_px(at_s - f64::from(late) * FRAME_S)), false);
        }
        guard.end()
    })
}

#[test]
fn delay_is_measured_to_the_frame_by_the_third_pulse() {
    for pulse in [swing(0.3, 30.0, 1.0 / 15.0, 0.2), swing(0.3, 60.0, 1.0 / 60.0, 0.1)] {
        for late in [2, 3, 6, 12, 20, 30] {
            let (found, period) = (found(late, &pulse), frames(&pulse) as usize);
            let named = found[..3].iter().flatten().next();
            // two pulses may be over before one is visible
            let delay = found.iter().flatten().find(|&&late| late != NEVER);
            // pulses at equal intervals look alike
            let is_right = |by: &usize| *by != NEVER && by.abs_diff(late as usize).is_multiple_of(period);
            assert!(named.is_some() && delay.is_some_and(is_right), "{late}: {found:?}");
        }
    }
}

#[test]
fn push_is_not_taken_for_late_pictures() {
    let pulse = swing(0.05, 30.0, 1.0 / 15.0, 0.2);
    let found = |pushed_px: f64| {
        let mut guard = DelayGuard::new(FRAME_HZ, LIMIT);
        (0..2)
            .map(|number| {
                let begin_s = f64::from(3 + number * frames(&pulse)) * FRAME_S + 0.001;
                guard.begin(begin_s, pulse.clone());
                for frame in 1..=frames(&pulse) {
                    let age_s = f64::from(frame) * FRAME_S;
                    // the swing that follows a push has the suspension's frequency, not the drive's
                    let push_px = pushed_px * (std::f64::consts::TAU * 11.0 * age_s).sin();
                    guard.frame(begin_s + age_s, Some(Vector3::new(push_px, 0.0, 0.0)), false);
                }
                guard.end()
            })
            .last()
            .flatten()
    };
    let driven_px = (0..40).map(|i| corner_px(pulse.at_px(f64::from(i) * FRAME_S))).fold(0.0, f64::max);
    assert!((0.8..3.0).contains(&driven_px), "{driven_px}");
    assert_eq!([1.0, 2.0, 3.0].map(|times| found(times * driven_px)), [None; 3]);
}

#[test]
fn pictures_in_time_and_weak_pulses_give_no_finding() {
    assert_eq!(found(0, &swing(0.3, 30.0, 1.0 / 15.0, 0.1)), [None; 4]);
    assert_eq!(found(6, &swing(0.001, 30.0, 1.0 / 15.0, 0.1)), [None; 4]);
    assert_eq!(DelayGuard::new(FRAME_HZ, LIMIT).end(), None, "no frames");
}

#[test]
fn stamps_that_are_off_by_a_part_of_a_frame_hide_no_late_pictures() {
    let pulse = swing(0.3, 60.0, 1.0 / 60.0, 0.3);
    let found = |late: usize, higher: f64| {
        let mut guard = DelayGuard::new(FRAME_HZ, LIMIT);
        let begin_s = |number: u32| f64::from(3 + number * (frames(&pulse) + 20)) * FRAME_S + 0.001;
        let shown_px = |at_s: f64| {
            let begun = (0..2).rev().map(begin_s).find(|begin_s| *begin_s <= at_s);
            begun.map_or(Vector3::zeros(), |begin_s| higher * pulse.at_px(at_s - begin_s))
        };
        let named = [0, 1].map(|number| {
            guard.begin(begin_s(number), pulse.clone());
            for frame in 0..frames(&pulse) + 20 {
                let at_s = begin_s(number) + f64::from(frame) * FRAME_S;
                guard.frame(at_s, Some(shown_px(at_s - late as f64 * FRAME_S)), false);
            }
            guard.end()
        });
        named[1]
    };
    let driven_px = (0..30).map(|i| corner_px(pulse.at_px(f64::from(i) * FRAME_S))).fold(0.0, f64::max);
    let higher = 5.0 / driven_px;
    assert_eq!(found(6, higher), Some(6));
    assert_eq!(found(0, higher), None);
}

#[test]
fn late_pictures_with_a_stuttering_coil_are_detected_by_swing_shape() {
    let pulse = swing(0.03, 60.0, 1.0 / 60.0, 0.1);
    let found = |late: u32| {
        let mut guard = DelayGuard::new(FRAME_HZ, LIMIT);
        [0, 1].map(|number| {
            let begin_s = f64::from(3 + number * (frames(&pulse) + 20)) * FRAME_S + 0.001;
            guard.begin(begin_s, pulse.clone());
            for frame in 0..frames(&pulse) + 20 {
                // the plate swings farther while one coil of two is off
                let stutter = [1.0, 1.9, 1.3, 0.7, 1.8][frame as usize % 5];
                let age_s = f64::from(frame) * FRAME_S - f64::from(late) * FRAME_S;
                guard.frame(begin_s + f64::from(frame) * FRAME_S, Some(stutter * pulse.at_px(age_s.max(0.0))), false);
            }
            guard.end()
        })
    };
    assert_eq!(found(0), [None; 2]);
    assert_eq!(found(4)[1], Some(4));
}

#[test]
fn equal_pulses_in_which_the_plate_swings_before_its_plan_are_in_time() {
    let pulse = swing(0.1, 60.0, 1.0 / 60.0, 0.03);
    let mut guard = DelayGuard::new(FRAME_HZ, LIMIT);
    let frames = frames(&pulse) + 4;
    let begin_s = |number: u32| f64::from(3 + number * frames) * FRAME_S + 0.001;
    let seen_px = |at_s: f64| {
        let begun = (0..6).rev().map(begin_s).find(|begin_s| *begin_s <= at_s);
        begun.map_or(Vector3::zeros(), |begin_s| 1.2 * pulse.at_px(at_s - begin_s))
    };
    for number in 0..6 {
        guard.begin(begin_s(number), pulse.clone());
        for frame in 0..frames {
            let at_s = begin_s(number) + f64::from(frame) * FRAME_S;
            guard.frame(at_s, Some(seen_px(at_s + FRAME_S)), false);
        }
        assert_eq!(guard.end(), None, "pulse {number}");
    }
}

/// Findings in pulses that begin at these frames, in pictures `late` frames late; `height` is the displacement of the
/// plate in a frame as a multiple of the planned one.
fn found_in(begins: &[u32], pulse: &PlateSwing, late: u32, height: impl Fn(u32) -> f64) -> Vec<Option<usize>> {
    let mut guard = DelayGuard::new(FRAME_HZ, LIMIT);
    let begin_s = |frame: u32| f64::from(frame) * FRAME_S + 0.001;
    let seen_px = |at: u32| {
        let begun = begins.iter().rev().find(|begin| at >= **begin);
        let driven_px = |begin: &u32| pulse.at_px(f64::from(at) * FRAME_S - begin_s(*begin));
        (height(at) * begun.map_or(Vector3::zeros(), driven_px)).add_scalar(0.02)
    };
    let ends = begins.iter().skip(1).copied().chain(begins.last().map(|last| last + 14));
    let mut findings = Vec::new();
    for (begin, end) in begins.iter().zip(ends) {
        guard.begin(begin_s(*begin), pulse.clone());
        for frame in *begin..end {
            guard.frame(f64::from(frame) * FRAME_S, Some(seen_px(frame.saturating_sub(late))), false);
        }
        findings.push(guard.end());
    }
    findings
}

#[test]
fn short_pulses_whose_frames_fit_several_delays_agree_on_the_one_that_explains_all() {
    // the shortest delay that fits alone differs from pulse to pulse by more than a frame
    let pulse = swing(0.045, 60.0, 1.0 / 60.0, 0.0);
    let begins = [35, 48, 57, 64, 82, 100];
    let found = found_in(&begins, &pulse, 19, |_| 0.8);
    assert!(found[..4].iter().any(Option::is_some), "{found:?}");
    assert_eq!(found_in(&begins, &pulse, 0, |_| 0.8), [None; 6]);
}

#[test]
fn pulse_that_shows_neither_does_not_hide_late_pictures() {
    // in the second pulse the plate swings farther than planned, as while its resonance shifts
    for (speed_mps, sustain_s, late, second, gap) in
        [(0.055, 0.4, 3, [1.5, 0.0], 36), (0.03, 0.4, 4, [1.3, 0.4], 39), (0.02, 0.4, 5, [1.6, 0.4], 36)]
    {
        let pulse = swing(speed_mps, 60.0, 1.0 / 60.0, sustain_s);
        let begins = [20, 20 + gap, 20 + 2 * gap];
        let is_second = |frame: u32| (begins[1]..begins[2] - late).contains(&frame);
        let height = |frame: u32| if is_second(frame) { second[0] + second[1] * f64::from(frame % 2) } else { 1.0 };
        let found = found_in(&begins, &pulse, late, height);
        assert!(found.iter().flatten().all(|lag| *lag == late as usize) && found[2].is_some(), "{found:?}");
        assert_eq!(found_in(&begins, &pulse, 0, height), [None; 3]);
    }
}

#[test]
fn pulses_that_swing_the_plate_less_than_planned_are_in_time_where_earlier_plans_fit_by_chance() {
    // both strong pulses show the height that was planned for the second weak one
    let pulse = |height: f64| swing(0.046 * height, 60.0, 1.0 / 60.0, 0.18);
    let heights = [1.0, 1.0, 1.28, 1.28];
    let mut guard = DelayGuard::new(FRAME_HZ, LIMIT);
    let begin_s = |number: usize| (3 + 15 * number) as f64 * FRAME_S + 0.001;
    for (number, height) in heights.into_iter().enumerate() {
        guard.begin(begin_s(number), pulse(height));
        for frame in 0..15 {
            let since_s = f64::from(frame) * FRAME_S;
            guard.frame(begin_s(number) + since_s, Some(pulse(0.98).at_px(since_s)), false);
        }
        assert_eq!(guard.end(), None, "pulse {number}");
    }
}

/// Where a plate is seen that swings as planned in pulses one after another, `off_px` from its place, in `late` frames.
fn knocked(off_px: Vector3<f64>, late: u32) -> (Option<f64>, bool) {
    let pulse = swing(0.3, 30.0, 1.0 / 15.0, 1.0);
    let mut guard = DelayGuard::new(FRAME_HZ, LIMIT);
    guard.begin(3.0 * FRAME_S, pulse.clone());
    let shown_px =
        |frame: u32| pulse.at_px(f64::from(frame) * FRAME_S - 3.0 * FRAME_S) * f64::from(u8::from(frame >= 3));
    for frame in 1..20u32 {
        guard.frame(f64::from(frame) * FRAME_S, Some(shown_px(frame.saturating_sub(late)) + off_px), false);
    }
    (guard.knocked_px(), guard.looks_late())
}

#[test]
fn plate_that_swings_about_another_place_was_knocked_and_is_not_late() {
    let off_px = Vector3::new(3.0, -1.0, 2.0);
    let (by_px, is_late) = knocked(off_px, 0);
    assert!(by_px.is_some_and(|px| (px - corner_px(off_px)).abs() < 0.1) && !is_late, "{by_px:?}");
    assert_eq!(knocked(Vector3::zeros(), 0), (None, false));
    assert_eq!(knocked(Vector3::zeros(), 5), (None, true));
    assert!(knocked(off_px, 5).1, "both");
    let mut guard = DelayGuard::new(FRAME_HZ, LIMIT);
    let nowhere = [1, 2, 3].map(|frame| {
        guard.frame(f64::from(frame) * FRAME_S, None, true);
        guard.knocked_px()
    });
    assert_eq!(nowhere, [None, None, Some(f64::INFINITY)]);
}
