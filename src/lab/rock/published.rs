//! The paper's figures of rocking: a steady orbit (Fig. 5), its instability (Fig. 6), a ramped wave that attracts other
//! starts (Fig. 8), two orientations on one drive (Fig. 9), and an amplitude that is raised until the block topples.

use super::block::Block;
use super::motion::{End, Release};
use super::selection::{on_drive, raise};
use super::{Rock, table_figures, track_chart};
use crate::sweep::Progress;
use crate::texts::{figures, sheet};
use crate::{ExperimentResult, LabError, LabRig};
use upm_chart::Color;
use upm_core::units::mm_from_m;

/// The block of Fig. 9: its edges differ by a tenth; the paper does not print its size.
const SIMILAR: Release = Release { block: Block { length_m: 0.02, height_m: 0.022 }, restitution: 0.5, tilt_rad: 0.1 };
/// Beginning of the upward acceleration in Fig. 9, as a fraction of the peak.
const WINDOW_FROM: f64 = 0.5;
/// Length of Fig. 9, s.
const SELECTION_S: f64 = 0.2;
/// Peak from which the amplitude is raised, rad.
const RAISED_FROM_RAD: f64 = 0.1;

/// Reproduces all figures.
///
/// # Errors
///
/// None in the published settings.
pub fn reproduce(_: &LabRig, progress: Progress<'_>) -> Result<ExperimentResult, LabError> {
    let mut outcome = ExperimentResult::default();
    square_wave(&mut outcome)?;
    ramped_wave(&mut outcome)?;
    progress(0.8);
    selection(&mut outcome)?;
    raising(&mut outcome)?;
    Ok(outcome)
}

/// Figs. 5 and 6: orbit and instability on the square wave.
fn square_wave(outcome: &mut ExperimentResult) -> Result<(), LabError> {
    let rock = Rock::published();
    let wave = rock.drive()?.wave();
    let [exact, high] = [1.0, rock.start].map(|share| rock.release(share).motion(&wave, rock.time_s));
    let kept_s = exact.peaks.iter().take_while(|peak| (peak[1] / rock.peak_rad - 1.0).abs() < 0.01).last();
    outcome.figures.extend(figures([
        ("square wave: growth of deviations in a period", rock.release(1.0).multiplier(&wave)),
        ("exact start: stays within 1 % for", kept_s.map_or(0.0, |peak| peak[0])),
        ("start 6 % high: first peak", high.peak_rad(0) / rock.peak_rad),
        ("start 6 % high: second peak", high.peak_rad(1) / rock.peak_rad),
        ("start 6 % high: lies flat after", if high.end == End::Flat { high.end_s() } else { f64::NAN }),
        ("least force on the corner in these", exact.least_contact.min(high.least_contact)),
    ]));
    outcome.figures.extend(table_figures(&wave, " for them"));
    let both = [("exact start", &exact), ("6 % high", &high)];
    outcome.charts.push(track_chart("rock-square", &both, Some(rock.peak_rad)));
    Ok(())
}

/// Fig. 8, and the range of starts that each kind of wave attracts.
fn ramped_wave(outcome: &mut ExperimentResult) -> Result<(), LabError> {
    let rock = Rock::ramped();
    let drive = rock.drive()?;
    let (square, ramped) = (drive.wave(), drive.ramped(rock.ramp));
    let motion = rock.release(rock.start).motion(&ramped, rock.time_s);
    let last_rad = motion.last_peak_rad();
    let settled = motion.peaks.iter().rev().take_while(|peak| (peak[1] / last_rad - 1.0).abs() < 0.1).last();
    outcome.figures.extend(figures([
        ("ramped wave: start at 0.30 rad comes to", last_rad),
        ("within 10 % of that after", settled.map_or(f64::NAN, |peak| peak[0])),
        ("least force on the corner", motion.least_contact),
    ]));
    outcome.figures.extend(table_figures(&ramped, " for it"));
    outcome.charts.push(track_chart("rock-ramped", &[("0.30 rad", &motion)], Some(last_rad)));
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
    outcome.sheet = Some(sheet("rock", rows.collect()));
    Ok(())
}

/// Fig. 9: two orientations on one drive.
fn selection(outcome: &mut ExperimentResult) -> Result<(), LabError> {
    let none = || LabError::Setting("no such drive".into());
    let ([standing, lying], peaks_rad) = on_drive(&SIMILAR, WINDOW_FROM, SELECTION_S).ok_or_else(none)?;
    let peaks =
        [("20 x 22 mm, standing: peak after the impact", peaks_rad[0]), ("the same block, lying", peaks_rad[1])];
    outcome.figures.extend(figures(peaks));
    let both = [("standing", &standing), ("lying", &lying)];
    outcome.charts.push(track_chart("rock-selection", &both, None));
    Ok(())
}

/// Amplitude raised until the block topples.
fn raising(outcome: &mut ExperimentResult) -> Result<(), LabError> {
    let rock = Rock { peak_rad: RAISED_FROM_RAD, ..Rock::published() };
    let none = || LabError::Setting("no drive raises the block".to_owned());
    let raised = raise(&rock.cycle()).ok_or_else(none)?;
    let impacts = if raised.motion.end == End::Topples { raised.motion.impacts_s.len() as f64 } else { f64::NAN };
    let planned = raised.peaks_rad.iter().skip(1).zip(&raised.motion.peaks);
    let off = planned.map(|(planned_rad, peak)| (peak[1] / planned_rad - 1.0).abs()).fold(0.0, f64::max);
    outcome.figures.extend(figures([
        ("impacts from 0.10 rad to toppling, 15 % a period", impacts),
        ("largest error of a peak on the way", off),
        ("least force on the corner on the way", raised.motion.least_contact),
    ]));
    outcome.figures.extend(table_figures(&raised.wave, " for it"));
    let track = track_chart("rock-raised", &[("block", &raised.motion)], None);
    let ends = [0.0, raised.wave.length_s()].map(|t_s| [t_s, rock.block.balance_rad()]);
    outcome.charts.push(track.dashes("balance", Color::Gray, ends));
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
        let peaks = [figure("start 6 % high: first"), figure("start 6 % high: second")];
        assert!(peaks[0] < 0.98 && peaks[1] > 1.02 && figure("start 6 % high: lies flat") < 2.0, "{peaks:?}");
        assert!((figure("ramped wave") / 0.15 - 1.0).abs() < 0.05 && figure("within 10 %") < 0.5);
        assert!((figure("the same block, lying") / 0.05 - 1.0).abs() < 0.15);
        assert!(figure("impacts from 0.10 rad") > 5.0);
        let forces = outcome.figures.iter().filter(|figure| figure.name.starts_with("least force"));
        assert!(forces.clone().count() == 3 && forces.into_iter().all(|figure| figure.measured >= 0.0));
    }
}
