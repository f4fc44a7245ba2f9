//! `upm locate`: table and parts in picture files.

mod doubts;
mod naming;
mod panels;
mod picture;
mod report;
mod scale;
mod search;
mod setup;
mod tone;

use serde_json::json;

use super::args::{Common, LocateArgs};
use super::output::{Failure, print_json};
use search::locate_picture;
use setup::LocateSetup;

/// Runs `upm locate`. Exit status: 0 if all pictures show table and parts, else the worst of any picture.
pub(super) fn locate(args: &LocateArgs, common: Common) -> Result<u8, Failure> {
    let setting = LocateSetup::of(args)?;
    let several = args.images.len() > 1;
    let mut worst = 0;
    for (index, image) in args.images.iter().enumerate() {
        // a subfolder where there are several pictures
        let stages = args.stages.clone();
        let stages = stages.map(|folder| if several { folder.join((index + 1).to_string()) } else { folder });
        let made = locate_picture(image, stages.as_deref(), &setting).and_then(|located| {
            let kinds: Vec<&str> = located.found.detections.iter().map(|part| setting.kind_name(part.kind)).collect();
            let written = stages.map_or(Ok(Vec::new()), |folder| panels::write(&folder, &located.found, &kinds))?;
            Ok((written, located))
        });
        match made {
            Ok((_, located)) if common.json && several => {
                report::print_line(image, report::as_json(&located, &setting))?;
            }
            Ok((_, located)) if common.json => print_json(&report::as_json(&located, &setting))?,
            Ok((written, located)) => {
                if several {
                    outln!("{}", image.display())?;
                }
                report::print_located(&located, &setting)?;
                written.iter().try_for_each(|path| outln!("written: {}", path.display()))?;
            }
            Err(failure) => {
                if common.json && several {
                    report::print_line(image, json!({ "error": failure.lines.join("; ") }))?;
                }
                worst = worst.max(failure.report());
            }
        }
    }
    Ok(worst)
}
