//! `upm locate --reference`: the same search by standard algorithms.

use std::path::Path;

use super::naming::NamedPart;
use super::picture;
use super::report::{LocateMethod, LocatedPicture, TimeUs};
use super::scale::{PlateSide, SideSource};
use super::setup::LocateSetup;
use crate::cli::args::Common;
use crate::cli::output::Failure;
use crate::cli::progress::{LateProgress, with_progress};
use upm_core::time::{Clock, MonotonicClock};
use upm_perception::vision::{DebugImages, Detection, Survey};
use upm_recording::LocalisedRecord;
use upm_reference::{find_parts, locate_table};

/// Reads the picture at `image` and finds table and parts by [`upm_reference`], without drawing stages.
pub(super) fn locate_by_reference(
    image: &Path,
    setting: &LocateSetup,
    common: Common,
) -> Result<LocatedPicture, Failure> {
    with_progress(LateProgress::at_once(common), &format!("searching {}", image.display()), |_| located(image, setting))
}

fn located(image: &Path, setting: &LocateSetup) -> Result<LocatedPicture, Failure> {
    let clock = MonotonicClock::new();
    let frame = picture::read(image)?.frame;
    let decode = clock.elapsed();
    let lenses = setting.lenses(&frame).map_err(|fault| Failure::bad_input(format!("{}: {fault}", image.display())))?;
    let begun = clock.elapsed();
    let side_m = setting.assumed_side_m();
    let first = lenses.first().ok_or_else(|| Failure::bad_input("no lens"))?;
    let view = locate_table(&frame, first, side_m)
        .map_err(|fault| Failure::failed(format!("{}: {fault}", image.display())))?;
    let found = clock.elapsed();
    let detections = find_parts(&view, &setting.kinds, setting.dark_parts);
    let done = clock.elapsed();
    let time_us = TimeUs::of(decode, [begun, found, done]);
    let (table, stages, localise_us) = (view.table, DebugImages::default(), time_us.localise);
    let part = |part: &Detection| {
        let diameter_m = 2.0 * part.radius_px / table.px_per_m_at(part.position_m);
        NamedPart { part: part.clone(), diameter_m, doubts: Vec::new() }
    };
    let parts = detections.iter().map(part).collect();
    let (side_m, source) = setting.plate_side.unwrap_or((side_m, SideSource::Assumed));
    let (side, survey) = (PlateSide::known(side_m, source), Survey::default());
    let found = LocalisedRecord { frame, table, detections, stages, localise_us };
    Ok(LocatedPicture { found, method: LocateMethod::Reference, time_us, parts, others: Vec::new(), survey, side })
}
