//! The paper's figures of rocking: a steady orbit (Fig. 5), its instability (Fig. 6), a ramped wave that attracts other
//! starts (Fig. 8), two orientations on one drive (Fig. 9), and an amplitude that is raised until the block topples.

use rand::RngExt;

use super::block::Block;
use super::motion::{End, Motion, Release};
use super::raising::raise;
use super::selection::{Selected, on_drive};
use super::{Rock, table_figures, track_chart, wave_chart};
use crate::sweep::{Progress, parallel};
use crate::{DataSheet, ExperimentResult, Figure, LabFault, LabRig};
use upm_chart::{Chart, Color};
use upm_core::random::Streams;
use upm_core::units::mm_from_m;

/// Blocks drawn at random for the check of the solver.
const BLOCKS: usize = 20;
/// The block of Fig. 9: its edges differ by a tenth; the paper does not print its size.
const SIMILAR: Release = Release { block: Block { length_m: 0.02, height_m: 0.022 }, restitution: 0.5, tilt_rad: 0.1 };
/// Beginning of the upward acceleration in Fig. 9, as a fraction of the peak, and the values that are compared.
const WINDOW_FROM: f64 = 0.5;
const WINDOWS_FROM: [f64; 10] = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0];
/// Length of Fig. 9, s.
const SELECTION_S: f64 = 0.2;
/// Peak from which the amplitude is raised, rad.
const RAISED_FROM_RAD: f64 = 0.1;

/// Reproduces all figures.
///
/// # Errors
///
/// None in the published settings.
pub fn reproduce(rig: &LabRig, progress: Progress<'_>) -> Result<ExperimentResult, LabFault> {
    let mut outcome = ExperimentResult::default();
    random_blocks(rig.seed, &|share| progress(0.3 * share), &mut outcome);
    square_wave(&mut outcome)?;
    progress(0.5);
    ramped_wave(&mut outcome)?;
    progress(0.8);
    selection(&mut outcome)?;
    raising(&mut outcome)?;
    progress(1.0);
    Ok(outcome)
}

/// Orbits of random blocks, solved with elliptic integrals and integrated.
fn random_blocks(seed: u64, progress: Progress<'_>, outcome: &mut ExperimentResult) {
    let mut rng = Streams::new(seed).stream("rock");
    let rocks: Vec<Rock> = (0..BLOCKS)
        .map(|_| {
            let length_m = rng.random_range(0.01..0.1);
            let block = Block { length_m, height_m: length_m * rng.random_range(0.5..2.0) };
            let peak_rad = block.balance_rad() * rng.random_range(0.05..0.25);
            let (from, to) = (rng.random_range(0.5..1.0), rng.random_range(0.0..0.4));
            Rock { block, restitution: rng.random_range(0.4..0.9), peak_rad, from, to, ..Rock::published() }
        })
        .collect();
    let cycles = parallel(&rocks, progress, |rock| {
        let drive = rock.drive().ok()?;
        Some((drive, rock.release(1.0).motion(&drive.wave(), 1.5 * drive.period_s)))
    });
    let found = || rocks.iter().zip(cycles.iter().flatten());
    // a corner that lifts leaves the model before the peak
    let off: Vec<[f64; 2]> = found()
        .filter_map(|(rock, (drive, motion))| {
            let [at_s, peak_rad] = *motion.peaks.first()?;
            Some([at_s / drive.period_s - 1.0, peak_rad / rock.peak_rad - 1.0].map(f64::abs))
        })
        .collect();
    let largest = |i: usize| off.iter().map(|off| off[i]).fold(0.0, f64::max);
    let [found, kept] = [found().count(), off.len()].map(|count| count as f64);
    let source = "blocks of 10 to 100 mm drawn at random";
    outcome.figures.extend([
        Figure::against("steady orbits found, of random blocks", "1", found, BLOCKS as f64, source),
        Figure::alone("of these, corner never lifts", "1", kept, "Eq. 3.3b"),
        Figure::alone("largest error of the elliptic period", "1", largest(0), "against the integrated one"),
        Figure::alone("largest error of the peak after it", "1", largest(1), "against the steady one"),
    ]);
}

/// Figs. 5 and 6: orbit and instability on the square wave.
fn square_wave(outcome: &mut ExperimentResult) -> Result<(), LabFault> {
    let rock = Rock::published();
    let wave = rock.drive()?.wave();
    let [exact, high] = [1.0, rock.start].map(|share| rock.release(share).motion(&wave, rock.time_s));
    let level = |motion: &Motion, i: usize| motion.peaks.get(i).map_or(f64::NAN, |peak| peak[1] / rock.peak_rad);
    let kept_s = exact.peaks.iter().take_while(|peak| (peak[1] / rock.peak_rad - 1.0).abs() < 0.01).last();
    let dead_s = if high.end == End::Flat { high.track.last().map_or(f64::NAN, |at| at[0]) } else { f64::NAN };
    let multiplier = rock.release(1.0).multiplier(&wave);
    let least = exact.least_contact.min(high.least_contact);
    outcome.figures.extend([
        Figure::alone("square wave: growth of deviations in a period", "1", multiplier, "stable below 1"),
        Figure::alone("exact start: stays within 1 % for", "s", kept_s.map_or(0.0, |peak| peak[0]), "Fig. 5: 2 s"),
        Figure::alone("start 6 % high: first peak", "1", level(&high, 0), "of the steady one; Fig. 6: too low"),
        Figure::alone("start 6 % high: second peak", "1", level(&high, 1), "of the steady one; Fig. 6: too high"),
        Figure::alone("start 6 % high: lies flat after", "s", dead_s, "Fig. 6: within 2 s"),
        Figure::alone("least force on the corner in these", "1", least, "Eq. 3.3b, of the weight"),
    ]);
    outcome.figures.extend(table_figures(&wave, " for them"));
    let both = [("exact start", &exact), ("6 % high", &high)];
    outcome.charts.push(track_chart("rock-square", "Square wave (Figs. 5 and 6)", &both, Some(rock.peak_rad)));
    outcome.charts.push(wave_chart("rock-square-table", &wave));
    Ok(())
}

/// Fig. 8, and the range of starts that each kind of wave attracts.
fn ramped_wave(outcome: &mut ExperimentResult) -> Result<(), LabFault> {
    let rock = Rock::ramped();
    let drive = rock.drive()?;
    let (square, ramped) = (drive.wave(), drive.ramped(rock.ramp));
    let motion = rock.release(rock.start).motion(&ramped, rock.time_s);
    let last_rad = if motion.end == End::Rocks { motion.peaks.last().map_or(f64::NAN, |peak| peak[1]) } else { 0.0 };
    let settled = motion.peaks.iter().rev().take_while(|peak| (peak[1] / last_rad - 1.0).abs() < 0.1).last();
    outcome.figures.extend([
        Figure::against("ramped wave: start at 0.30 rad comes to", "rad", last_rad, 0.15, "Fig. 8"),
        Figure::alone("within 10 % of that after", "s", settled.map_or(f64::NAN, |peak| peak[0]), "Fig. 8: 0.5 s"),
        Figure::alone("least force on the corner", "1", motion.least_contact, "Eq. 3.3b, of the weight"),
    ]);
    outcome.figures.extend(table_figures(&ramped, " for it"));
    outcome.charts.push(track_chart("rock-ramped", "Ramped wave (Fig. 8)", &[("0.30 rad", &motion)], Some(last_rad)));
    outcome.charts.push(wave_chart("rock-ramped-table", &ramped));
    let steep = Rock::published();
    let steep_drive = steep.drive()?;
    let rows =
        [(&rock, square), (&rock, ramped), (&steep, steep_drive.wave()), (&steep, steep_drive.ramped(rock.ramp))];
    let rows = rows.into_iter().enumerate().map(|(i, (rock, wave))| {
        let release = rock.release(1.0);
        let [low, high] = release.captured(&wave).unwrap_or([f64::NAN; 2]);
        let ramp = if i % 2 == 0 { 0.0 } else { 10.0 };
        vec![mm_from_m(rock.block.length_m), rock.from, rock.to, ramp, release.multiplier(&wave), low, high]
    });
    let columns = ["length (mm)", "from", "to", "ramp (% of period)", "growth", "lowest kept", "highest kept"];
    outcome.sheet = Some(DataSheet::new(columns, rows.collect()));
    Ok(())
}

/// Fig. 9, and the decrease of the difference with the window.
fn selection(outcome: &mut ExperimentResult) -> Result<(), LabFault> {
    let none = || LabFault::Setting("no such drive".into());
    let on_drive = |from| on_drive(&SIMILAR, from, SELECTION_S).ok_or_else(none);
    let Selected { motions: [standing, lying], peaks_rad, .. } = on_drive(WINDOW_FROM)?;
    outcome.figures.extend([
        Figure::alone("20 x 22 mm, standing: peak after the impact", "rad", peaks_rad[0], "Fig. 9: about 0.10"),
        Figure::against("the same block, lying", "rad", peaks_rad[1], 0.05, "Fig. 9"),
    ]);
    let both = [("standing", &standing), ("lying", &lying)];
    outcome.charts.push(track_chart("rock-selection", "Two orientations on one drive (Fig. 9)", &both, None));
    let found = WINDOWS_FROM.iter().map(|&from| on_drive(from)).collect::<Result<Vec<_>, _>>()?;
    let curve: Vec<[f64; 2]> =
        found.iter().map(|found| [found.window, found.peaks_rad[1] / found.peaks_rad[0]]).collect();
    let axes = ["length of the upward acceleration over the time between the impacts", "ratio of the peaks"];
    let chart = Chart::plot("rock-window", "Peak of the lying block over that of the standing one", axes);
    outcome.charts.push(chart.dots("first peaks", Color::Orange, curve));
    Ok(())
}

/// Amplitude raised until the block topples.
fn raising(outcome: &mut ExperimentResult) -> Result<(), LabFault> {
    let rock = Rock { peak_rad: RAISED_FROM_RAD, ..Rock::published() };
    let none = || LabFault::Setting("no drive raises the block".to_owned());
    let raised = raise(&rock.cycle()).ok_or_else(none)?;
    let impacts = if raised.motion.end == End::Topples { raised.motion.impacts_s.len() as f64 } else { f64::NAN };
    let planned = raised.peaks_rad.iter().skip(1).zip(&raised.motion.peaks);
    let least = raised.motion.least_contact;
    let off = planned.map(|(planned_rad, peak)| (peak[1] / planned_rad - 1.0).abs()).fold(0.0, f64::max);
    outcome.figures.extend([
        Figure::alone("impacts from 0.10 rad to toppling, 15 % a period", "1", impacts, "a block of 20 x 40 mm"),
        Figure::alone("largest error of a peak on the way", "1", off, "against the one that its drive is made for"),
        Figure::alone("least force on the corner on the way", "1", least, "Eq. 3.3b, of the weight"),
    ]);
    outcome.figures.extend(table_figures(&raised.wave, " for it"));
    let motion = [("block", &raised.motion)];
    let balance_rad = rock.block.balance_rad();
    let chart = track_chart("rock-raised", "Amplitude raised until the block topples", &motion, None);
    let ends = [[0.0, balance_rad], [raised.wave.length_s(), balance_rad]];
    outcome.charts.push(chart.dashes("balance", Color::Gray, ends));
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{assert_sources_are_short, lab_rig};

    #[test]
    fn published_figures_come_out() {
        let outcome = reproduce(&lab_rig("upm-1"), &|_| ()).unwrap();
        assert_sources_are_short(&outcome);
        let figure = |name: &str| outcome.figures.iter().find(|figure| figure.name.starts_with(name)).unwrap().measured;
        assert_eq!(figure("steady orbits found"), 20.0);
        assert!(figure("of these") >= 15.0, "the errors are those of most");
        assert!(figure("largest error of the elliptic period") < 1e-6 && figure("largest error of the peak") < 1e-6);
        let peaks = [figure("start 6 % high: first"), figure("start 6 % high: second")];
        assert!(peaks[0] < 0.98 && peaks[1] > 1.02 && figure("start 6 % high: lies flat") < 2.0, "{peaks:?}");
        assert!((figure("ramped wave") / 0.15 - 1.0).abs() < 0.05 && figure("within 10 %") < 0.5);
        assert!((figure("the same block, lying") / 0.05 - 1.0).abs() < 0.15);
        assert!(figure("impacts from 0.10 rad") > 5.0);
        let forces = outcome.figures.iter().filter(|figure| figure.name.starts_with("least force"));
        assert!(forces.clone().count() == 3 && forces.into_iter().all(|figure| figure.measured >= 0.0));
    }
}
