//! `upm locate`: plane and parts in picture files.

mod naming;
mod overlay;
mod picture;
mod report;
mod scale;
mod search;
mod setup;

use serde_json::json;

use super::args::{Common, LocateArgs};
use super::output::{Failure, print_json};
use search::locate_picture;
use setup::LocateSetup;

/// Runs `upm locate`. Exit status: 0 if all pictures show plane and parts, else the worst of any picture.
pub(super) fn locate(args: &LocateArgs, common: Common) -> Result<u8, Failure> {
    let setting = LocateSetup::of(args)?;
    let several = args.images.len() > 1;
    let mut worst = 0;
    for image in &args.images {
        let made = locate_picture(image, &setting).and_then(|located| {
            let drawn = args.overlay.as_ref().map(|folder| overlay::write(folder, image, &located, &setting));
            Ok((drawn.transpose()?, located))
        });
        match made {
            Ok((_, located)) if common.json && several => {
                report::print_line(image, report::as_json(&located, &setting))?;
            }
            Ok((_, located)) if common.json => print_json(&report::as_json(&located, &setting))?,
            Ok((drawn, located)) => {
                if several {
                    outln!("{}", image.display())?;
                }
                report::print_located(&located, &setting)?;
                drawn.into_iter().try_for_each(|path| outln!("written: {}", path.display()))?;
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
