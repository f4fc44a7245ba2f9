//! `upm locate --reference`: the same search by standard algorithms.

use std::path::Path;

use super::picture;
use super::report::{Located, Method, TimeUs};
use super::setting::Setting;
use crate::cli::output::Failure;
use upm_core::time::{Clock, MonotonicClock};
use upm_perception::vision::Stages;
use upm_recording::LocalisedRecord;
use upm_reference::{find_parts, locate_table};

/// Reads the picture at `image` and finds table and parts by [`upm_reference`]. It keeps no stages.
pub(super) fn look_by_reference(image: &Path, setting: &Setting) -> Result<Located, Failure> {
    let clock = MonotonicClock::new();
    let frame = picture::read(image)?.frame;
    let decode = clock.elapsed();
    let lens = setting.lens(&frame).map_err(|fault| Failure::bad_input(format!("{}: {fault}", image.display())))?;
    let begun = clock.elapsed();
    let view = locate_table(&frame, &lens, setting.plate_side_m)
        .map_err(|fault| Failure::failed(format!("{}: {fault}", image.display())))?;
    let found = clock.elapsed();
    let detections = find_parts(&view, &setting.kinds, setting.dark_parts);
    let done = clock.elapsed();
    let time_us = TimeUs::of(decode, [begun, found, done]);
    let (table, stages, localise_us) = (view.table, Stages::default(), time_us.localise);
    let found = LocalisedRecord { frame, table, detections, stages, localise_us };
    Ok(Located { found, method: Method::Reference, time_us })
}
