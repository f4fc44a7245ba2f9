//! Search of one picture for table, parts and other discs.

use std::path::Path;

use super::doubts::about_table;
use super::naming::{is_near, named};
use super::report::{Localised, LocatedPicture, TimeUs};
use super::scale::{PlateSide, SideSource};
use super::setup::LocateSetup;
use super::{panels, picture};
use crate::cli::output::Failure;
use upm_core::signal::Frame;
use upm_core::time::{Clock, MonotonicClock};
use upm_perception::vision::{
    CoinFinder, DebugImages, Survey, Table, TableFault, locate_table, locate_table_in_stages, survey,
};

/// Reads the picture at `image`, finds the table and the discs on it and names them; keeps the stages if they are to be
/// drawn into `stages`. If no table is found, the stages up to there are drawn nevertheless.
pub(super) fn locate_picture(
    image: &Path,
    stages: Option<&Path>,
    setting: &LocateSetup,
) -> Result<LocatedPicture, Failure> {
    let clock = MonotonicClock::new();
    let picture = picture::read(image)?;
    let decoded = clock.elapsed();
    if let Some(bits) = picture.bits {
        tracing::info!("{}: 16-bit picture; using {bits} significant bits", image.display());
    }
    let (frame, colors) = (picture.frame, picture.colors);
    let mut images = DebugImages::default();
    let table = find_table(&frame, setting, stages.map(|_| &mut images))
        .map_err(|fault| Failure::bad_input(format!("{}: {fault}", image.display())))?;
    if let (Err(_), Some(folder)) = (&table, stages) {
        panels::write_begun(folder, &frame, &images)?;
    }
    let table = table.map_err(|fault| Failure::failed(format!("{}: {}", image.display(), about_table(&fault))))?;
    let found = clock.elapsed();
    let (table, side, surveyed) = scaled(table, &frame, setting);
    let scaled = clock.elapsed();
    let size = [frame.width, frame.height];
    let mut finder = CoinFinder::new(&table, size, &setting.kinds, setting.dark_parts);
    let detections = finder.find(&frame);
    let done = clock.elapsed();
    // discs that only the part finder found are measured as well
    let is_whole = detections.iter().all(|part| surveyed.discs.iter().any(|disc| is_near(part, disc)));
    let survey = if is_whole { surveyed } else { survey(&frame, &table, &detections) };
    let (parts, others) = named(detections, &survey, &table, setting, side.source, colors.as_ref());
    if stages.is_some() {
        images.disk_response = finder.response();
    }
    let [decode, table_time, parts_time, survey_time] =
        [decoded, found - decoded, done - scaled, clock.elapsed() - done + (scaled - found)]
            .map(|time| 1e6 * time.as_secs_f64());
    let time_us = TimeUs { decode, table: table_time, parts: parts_time, survey: survey_time };
    let detections = parts.iter().map(|named| named.part.clone()).collect();
    let found = Localised { frame, table, detections, stages: images };
    Ok(LocatedPicture { found, time_us, parts, others, survey, side })
}

/// Finds the table through the rig's lens, or through the first of several lenses that makes it a square.
fn find_table(
    frame: &Frame,
    setting: &LocateSetup,
    mut stages: Option<&mut DebugImages>,
) -> Result<Result<Table, TableFault>, String> {
    let mut first = None;
    for lens in setting.lenses(frame)? {
        let table = match &mut stages {
            Some(stages) => locate_table_in_stages(frame, &lens, setting.assumed_side_m(), stages),
            None => locate_table(frame, &lens, setting.assumed_side_m()),
        };
        match table {
            Err(fault @ TableFault::NotASquare) => first = first.or(Some(fault)),
            table => return Ok(table),
        }
    }
    Ok(Err(first.unwrap_or(TableFault::NotASquare)))
}

/// The table with the given side or the one estimated from its discs, the source of that side, and the discs.
fn scaled(table: Table, frame: &Frame, setting: &LocateSetup) -> (Table, PlateSide, Survey) {
    let mut survey = survey(frame, &table, &[]);
    if let Some((side_m, source)) = setting.plate_side {
        return (table, PlateSide::known(side_m, source), survey);
    }
    let side = PlateSide::from_discs(&survey.discs, table.side_m, &setting.known);
    let factor = side.side_m / table.side_m;
    let corners = table.corners_px.map(|corner| table.lens.ideal_from_image(corner));
    let Some(table) = Table::from_ideal_corners(corners, side.side_m, &table.lens) else {
        let side = PlateSide::known(table.side_m, SideSource::Assumed);
        return (table, side, survey);
    };
    for disc in &mut survey.discs {
        (disc.at_m, disc.radius_m) = (disc.at_m * factor, disc.radius_m * factor);
    }
    (table, side, survey)
}
