//! Rocking on a table that is driven up and down (Singer and Seering, "Utilizing dynamic stability to orient parts",
//! section 3): a drive that keeps a block rocking, and the range of other starts and blocks that it keeps rocking.

mod block;
mod elliptic;
mod motion;
mod orbit;
mod published;
mod raising;
mod selection;
mod stability;
mod wave;

use self::block::Block;
use self::motion::{End, Motion, Release};
use self::orbit::RockingCycle;
pub use self::published::reproduce;
use self::wave::{Square, Wave};
use super::settings::{Field, Setting, settings};
use super::sweep::Progress;
use super::{ExperimentResult, Figure, LabFault};
use upm_chart::{Chart, Color};
use upm_core::units::{GRAVITY_MPS2, mm_from_m};

/// A block, its intended orbit, and its initial tilt.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rock {
    block: Block,
    restitution: f64,
    peak_rad: f64,
    from: f64,
    to: f64,
    ramp: f64,
    start: f64,
    time_s: f64,
}

/// Parameters of the block and its drive.
pub const SETTINGS: &[Setting<Rock>] = settings! {
    "length_mm", [1e-2, 1e4], 1e-3, block.length_m, "length of the face that it stands on";
    "height_mm", [1e-2, 1e4], 1e-3, block.height_m, "height of the block";
    "restitution", [0.05, 1.0], 1.0, restitution, "part of the centre's normal speed that an impact gives back";
    "peak_rad", [1e-3, 1.5], 1.0, peak_rad, "peak of the tilt on the steady orbit";
    "from", [0.0, 1.0], 1.0, from, "tilt at which the table's acceleration turns upward, of the peak";
    "to", [-1.0, 1.0], 1.0, to, "tilt at which it turns downward again, of the peak; negative: after the impact";
    "ramp", [0.0, 0.5], 1.0, ramp, "length of the wave's edges, of the period";
    "start", [0.01, 100.0], 1.0, start, "tilt at which it is let go, of the peak";
    "time_s", [0.01, 100.0], 1.0, time_s, "time for which it is followed";
};

impl Rock {
    /// The block of Figs. 5 and 6, started 6 % high. The paper prints neither its size nor the drive; these are our
    /// choice.
    pub fn published() -> Self {
        let block = Block { length_m: 0.02, height_m: 0.04 };
        Self { block, restitution: 0.5, peak_rad: 0.16, from: 0.8, to: 0.1, ramp: 0.0, start: 1.06, time_s: 2.0 }
    }

    /// A block like that of Fig. 8 on a wave with ramped edges, started at twice the steady tilt.
    pub fn ramped() -> Self {
        let block = Block { length_m: 0.024, height_m: 0.04 };
        let published = Self::published();
        Self { block, peak_rad: 0.15, from: 1.0, to: 0.6, ramp: 0.1, start: 2.0, time_s: 1.0, ..published }
    }

    fn cycle(&self) -> RockingCycle {
        let (from_rad, to_rad) = (self.from * self.peak_rad, self.to * self.peak_rad);
        let (block, restitution) = (self.block, self.restitution);
        RockingCycle { block, restitution, peaks_rad: [self.peak_rad; 2], from_rad, to_rad }
    }

    /// The wave of the steady orbit.
    fn drive(&self) -> Result<Square, LabFault> {
        let balance_rad = self.block.balance_rad();
        let limit = |key: &str, most_rad: f64, name: &str, found: f64| {
            Err(LabFault::Setting(format!("{key}: expected less than {most_rad:.4} ({name}), found {found}")))
        };
        if self.peak_rad >= balance_rad {
            return limit("peak_rad", balance_rad, "the tilt at which the block balances", self.peak_rad);
        }
        if self.start * self.peak_rad >= balance_rad {
            return limit("start", balance_rad / self.peak_rad, "the block's balance over peak_rad", self.start);
        }
        let none = || {
            LabFault::Setting(format!(
                "from, to: expected tilts between which the table's acceleration makes up for the impact, from above to, found {} and {}",
                self.from, self.to
            ))
        };
        self.cycle().drive().ok_or_else(none)
    }

    /// Release of the block on its orbit, or at `share` of its peak.
    fn release(&self, share: f64) -> Release {
        Release { block: self.block, restitution: self.restitution, tilt_rad: share * self.peak_rad }
    }
}

/// Drive, stability and final state of one block.
///
/// # Errors
///
/// A peak beyond the balance, or a window in which no drive compensates the impact's loss.
pub fn measure(rock: &Rock, _: Progress<'_>) -> Result<ExperimentResult, LabFault> {
    let drive = rock.drive()?;
    let wave = drive.ramped(rock.ramp);
    let motion = rock.release(rock.start).motion(&wave, rock.time_s);
    let orbit = rock.release(1.0).motion(&drive.wave(), 1.5 * drive.period_s);
    let mut figures = orbit_figures(rock, &drive, &wave, &orbit);
    figures.extend(fate_figures(rock, &motion));
    let lifts = [("on its orbit", &orbit), ("let go here", &motion)].into_iter();
    let lifts = lifts.filter(|(_, motion)| motion.end == End::Lifts).map(|(which, motion)| {
        let end_s = motion.track.last().map_or(0.0, |at| at[0]);
        format!("{which}: after {end_s:.3} s the table would have to pull at the block: the model ends there")
    });
    let notes = lifts.collect();
    let charts = vec![
        track_chart("rock-tilt", "Tilt of the block", &[("let go here", &motion)], Some(rock.peak_rad)),
        wave_chart("rock-table", &wave),
    ];
    Ok(ExperimentResult { figures, notes, charts, ..ExperimentResult::default() })
}

/// Parameters of the wave, and its effect near the orbit.
fn orbit_figures(rock: &Rock, drive: &Square, wave: &Wave, orbit: &Motion) -> Vec<Figure> {
    let alone = Figure::alone::<&str>;
    let peak = orbit.peaks.first().copied();
    let [at_s, peak_rad] = peak.unwrap_or([f64::NAN; 2]);
    let captured = rock.release(1.0).captured(wave).unwrap_or([f64::NAN; 2]);
    let mut figures = vec![
        alone("acceleration of the table upward", "m/s²", drive.up_mps2, "Singer and Seering, Fig. 4: A_X1"),
        alone("acceleration of the table downward", "m/s²", drive.down_mps2, "Fig. 4: A_X2"),
        alone("period, integrated", "ms", 1e3 * at_s, "Eqs. 3.7 to 3.15").with(peak.map(|_| 1e3 * drive.period_s)),
        alone("peak after a period of the square wave", "rad", peak_rad, "steady orbit")
            .with(peak.map(|_| rock.peak_rad)),
        alone("growth of small deviations in a period", "1", rock.release(1.0).multiplier(wave), "stable below 1"),
        alone("lowest start that is kept", "1", captured[0], "of the peak; 40 periods"),
        alone("highest start that is kept", "1", captured[1], "of the peak; 40 periods"),
    ];
    figures.extend(table_figures(wave, ""));
    figures
}

/// Stroke and largest speed of the table under a wave: the requirements on a shaker.
fn table_figures(wave: &Wave, whose: &str) -> [Figure; 2] {
    let [stroke_m, speed_mps] = wave.stroke_and_speed();
    [("stroke", "mm", stroke_m, "twice integrated"), ("largest speed", "mm/s", speed_mps, "integrated")].map(
        |(what, unit, value, source)| {
            Figure::alone(format!("{what} of the table{whose}"), unit, mm_from_m(value), source)
        },
    )
}

/// Peaks, end and contact forces of the block's motion.
fn fate_figures(rock: &Rock, motion: &Motion) -> Vec<Figure> {
    let alone = Figure::alone::<&str>;
    let peak = |i: usize| motion.peaks.get(i).map_or(f64::NAN, |peak| peak[1] / rock.peak_rad);
    let last = match motion.end {
        End::Rocks => motion.peaks.last().map_or(f64::NAN, |peak| peak[1]),
        End::Flat => 0.0,
        End::Topples | End::Lifts => f64::NAN,
    };
    let until = if motion.end == End::Rocks { f64::NAN } else { motion.track.last().map_or(f64::NAN, |at| at[0]) };
    vec![
        alone("first peak", "1", peak(0), "of the steady one"),
        alone("second peak", "1", peak(1), "of the steady one"),
        alone("last peak", "rad", last, "0: it lies flat"),
        alone("time until it lies flat, topples or lifts", "s", until, "-: it rocks on"),
        alone("least force on the corner", "1", motion.least_contact, "Eq. 3.3b, of the weight"),
        alone("friction that keeps the corner in place", "1", motion.friction, "Eq. 3.3b and along the table"),
    ]
}

fn track_chart(name: &str, title: &str, motions: &[(&str, &Motion)], level_rad: Option<f64>) -> Chart {
    let mut chart = Chart::plot(name, title, ["time (s)", "tilt (rad)"]);
    for ((label, motion), color) in motions.iter().zip([Color::Blue, Color::Orange]) {
        chart = chart.line(label, color, motion.track.iter().copied());
    }
    let end_s = motions.iter().filter_map(|(_, motion)| motion.track.last()).map(|at| at[0]).fold(0.0, f64::max);
    match level_rad {
        Some(level_rad) => chart.dashes("steady peak", Color::Gray, [[0.0, level_rad], [end_s, level_rad]]),
        None => chart,
    }
}

fn wave_chart(name: &str, wave: &Wave) -> Chart {
    let corners = wave.corners().into_iter().map(|[t_s, accel_mps2]| [1e3 * t_s, accel_mps2]);
    let free_fall = [[0.0, -GRAVITY_MPS2], [1e3 * wave.length_s(), -GRAVITY_MPS2]];
    Chart::plot(name, "Acceleration of the table", ["time (ms)", "acceleration upward (m/s²)"])
        .dashes("free fall", Color::Gray, free_fall)
        .line("table", Color::Blue, corners)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::{SettingAssignment, assigned};
    use rand::RngExt;
    use upm_core::random::Streams;

    fn set(text: &str) -> Result<ExperimentResult, LabFault> {
        let assignments: Vec<SettingAssignment> = text.split_whitespace().map(|one| one.parse().unwrap()).collect();
        measure(&assigned(SETTINGS, &Rock::published(), &assignments)?, &|_| ())
    }

    #[test]
    fn settings_outside_the_model_are_refused_with_the_limit() {
        for (text, fault) in [
            ("peak_rad=0.5", "peak_rad: expected less than 0.4636 (the tilt at which the block balances), found 0.5"),
            ("start=3", "start: expected less than 2.8978 (the block's balance over peak_rad), found 3"),
            ("from=0.1 to=0.2", "from, to: expected tilts between which"),
            ("from=0.5 to=-0.4", "from, to: expected tilts between which"),
        ] {
            let said = set(text).unwrap_err().to_string();
            assert!(said.starts_with(fault), "{said}");
        }
    }

    #[test]
    fn orbit_closes_and_its_period_is_the_integrated_one() {
        // the second block peaks within the clock's resolution of the period's end
        let at_the_end = "length_mm=96.04730020616665 height_mm=178.01041896225342 restitution=0.9114372428138772 peak_rad=0.09842018917013262 \
                          from=0.9223881417278829 to=0.4088090220554163 start=1";
        for text in ["length_mm=30 from=0.9 to=0.3", at_the_end] {
            for figure in set(text).unwrap().figures {
                assert!(figure.relative_error().is_none_or(|error| error.abs() < 1e-6), "{figure:?}");
            }
        }
    }

    /// Time and tilt of the next peak by steps of Eq. 3.3a: a symplectic step of a pendulum upside down, its corner on
    /// a table that presses; `None` where the table would have to pull.
    fn stepped_peak(rock: &Rock, drive: &Square) -> Option<[f64; 2]> {
        const STEPS: f64 = 400_000.0;
        let Block { length_m, height_m } = rock.block;
        let (arm_m, flat_rad) = (0.5 * length_m.hypot(height_m), height_m.atan2(length_m));
        let step_s = drive.period_s / STEPS;
        let (mut tilt_rad, mut speed_radps, mut struck) = (rock.peak_rad, 0.0f64, false);
        for i in 0..(1.5 * STEPS) as u32 {
            let t_s = step_s * (f64::from(i) + 0.5);
            let up = t_s > drive.from_s && t_s < drive.to_s;
            let weight = GRAVITY_MPS2 + if up { drive.up_mps2 } else { -drive.down_mps2 };
            let (sin, cos) = (flat_rad + tilt_rad).sin_cos();
            // a bar of I = (4/3) m r² about its corner
            let accel = -0.75 * weight / arm_m * cos;
            if weight + arm_m * (accel * cos - speed_radps * speed_radps * sin) < 0.0 {
                return None;
            }
            let before_radps = speed_radps;
            speed_radps += accel * step_s;
            tilt_rad += speed_radps * step_s;
            if struck && before_radps > 0.0 && speed_radps <= 0.0 {
                return Some([step_s * f64::from(i), tilt_rad]);
            }
            if tilt_rad < 0.0 {
                (speed_radps, tilt_rad, struck) = (-rock.restitution * speed_radps, 0.0, true);
            }
        }
        None
    }

    #[test]
    #[expect(clippy::print_stdout, reason = "the table, with --nocapture")]
    fn references_of_random_blocks_are_those_of_time_steps() {
        let mut rng = Streams::new(43).stream("blocks");
        let (mut blocks, mut compared, mut worst) = (0, 0, 0.0f64);
        while blocks < 24 {
            let length_m = 10f64.powf(rng.random_range(-5.0..0.0));
            let block = Block { length_m, height_m: length_m * 10f64.powf(rng.random_range(-0.6..0.8)) };
            let rock = Rock {
                block,
                restitution: rng.random_range(0.1..0.95),
                peak_rad: block.balance_rad() * rng.random_range(0.02..0.9),
                from: rng.random_range(0.1..1.0),
                to: rng.random_range(-0.5..0.9),
                start: 1.0,
                time_s: 0.01,
                ..Rock::published()
            };
            let Ok(drive) = rock.drive() else { continue };
            blocks += 1;
            let orbit = rock.release(1.0).motion(&drive.wave(), 1.5 * drive.period_s);
            let figures = orbit_figures(&rock, &drive, &drive.wave(), &orbit);
            let stepped = stepped_peak(&rock, &drive);
            println!("{blocks:2} {:?} e {:.2}: {stepped:?}", block, rock.restitution);
            assert_eq!(figures[2].reference.is_some(), stepped.is_some(), "{rock:?}");
            let Some([at_s, peak_rad]) = stepped else { continue };
            let off = [(2, 1e3 * at_s), (3, peak_rad)].map(|(i, value)| {
                assert!(figures[i].relative_error().unwrap().abs() < 1e-4, "{:?} {rock:?}", figures[i]);
                (value / figures[i].reference.unwrap() - 1.0).abs()
            });
            (compared, worst) = (compared + 1, worst.max(off[0]).max(off[1]));
        }
        println!("{compared} compared, largest error {worst:.1e}");
        assert!(compared >= 12 && worst < 1e-3, "{compared} {worst}");
    }
}
