//! `upm locate`: table and parts in picture files.

mod jpeg;
mod picture;
mod report;
mod setting;

use std::path::Path;

use serde_json::json;

use super::args::{Common, LocateArgs};
use super::failure::Failure;
use super::print_json;
use crate::time::{Clock, MonotonicClock};
use crate::vision::{CoinFinder, Detection, Table, locate_table};
use report::TimeUs;
use setting::Setting;

/// What is in a picture.
struct Located {
    table: Table,
    parts: Vec<Detection>,
    time_us: TimeUs,
}

pub(super) fn locate(args: &LocateArgs, common: Common) -> Result<u8, Failure> {
    let setting = Setting::of(args)?;
    if let [image] = args.images.as_slice() {
        let located = look(image, &setting)?;
        match common.json {
            true => print_json(&report::as_json(&located, &setting.kinds))?,
            false => report::say_located(&located, &setting.kinds)?,
        }
        return Ok(0);
    }
    let mut worst = 0;
    for image in &args.images {
        let found = look(image, &setting);
        if common.json {
            let value = match &found {
                Ok(located) => report::as_json(located, &setting.kinds),
                Err(failure) => json!({ "error": failure.lines.join("; ") }),
            };
            report::say_line(image, value)?;
        }
        match found {
            Ok(located) if !common.json => {
                say!("{}", image.display())?;
                report::say_located(&located, &setting.kinds)?;
            }
            Ok(_) => {}
            Err(failure) => worst = worst.max(failure.complain()),
        }
    }
    Ok(worst)
}

/// Reads the picture at `image`, finds the table and the parts on it.
fn look(image: &Path, setting: &Setting) -> Result<Located, Failure> {
    let clock = MonotonicClock::new();
    let picture = picture::read(image)?;
    let decoded = clock.elapsed();
    if let Some(bits) = picture.bits {
        tracing::info!("{}: levels of 16 bits, taken as {bits} bits", image.display());
    }
    let frame = picture.frame;
    let lens = setting.lens(&frame).map_err(|fault| Failure::bad_input(format!("{}: {fault}", image.display())))?;
    let begun = clock.elapsed();
    let (table, _) = locate_table(&frame, &lens, setting.plate_side_m)
        .map_err(|fault| Failure::failed(format!("{}: {fault}", image.display())))?;
    let tabled = clock.elapsed();
    let mut finder = CoinFinder::new(&table, [frame.width, frame.height], &setting.kinds, setting.dark_parts);
    let parts = finder.find(&frame);
    let done = clock.elapsed();
    let us = |from: std::time::Duration, to: std::time::Duration| 1e6 * (to - from).as_secs_f64();
    let time_us = TimeUs { decode: 1e6 * decoded.as_secs_f64(), table: us(begun, tabled), parts: us(tabled, done) };
    Ok(Located { table, parts, time_us })
}
