//! `upm locate`: table and parts in picture files.

mod canvas;
mod doubts;
mod maps;
mod naming;
mod panels;
mod picture;
mod report;
mod scale;
mod search;
mod setup;
mod tone;

use std::collections::BTreeSet;
use std::path::PathBuf;

use serde_json::json;

use super::args::{Common, LocateArgs};
use super::output::{Failure, print_json};
use report::Localised;
use search::locate_picture;
use setup::LocateSetup;

/// Runs `upm locate`. Exit status: 0 if all pictures show table and parts, else the worst of any picture.
pub(super) fn locate(args: &LocateArgs, common: Common) -> Result<u8, Failure> {
    let setting = LocateSetup::of(args)?;
    let several = args.images.len() > 1;
    let mut worst = 0;
    for (image, name) in args.images.iter().zip(names_of(&args.images)) {
        let made = locate_picture(image, &name, args, &setting).and_then(|located| {
            let kinds: Vec<&str> = located.found.detections.iter().map(|part| setting.kind_name(part.kind)).collect();
            Ok((draw(&located.found, &kinds, &name, args)?, located))
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

/// Draws the stages if `args` request it; `kinds` are those of the parts. Returns the paths.
fn draw(found: &Localised, kinds: &[&str], name: &str, args: &LocateArgs) -> Result<Vec<PathBuf>, Failure> {
    match &args.stages {
        Some(folder) => panels::write(&panels::folder_of(folder, name, args), found, kinds),
        None => Ok(Vec::new()),
    }
}

/// Output name of each picture: its file stem, numbered where several are equal.
fn names_of(images: &[PathBuf]) -> Vec<String> {
    let mut taken = BTreeSet::new();
    let mut free = |image: &PathBuf| {
        let stem = image.file_stem().map_or("picture".into(), |stem| stem.to_string_lossy().into_owned());
        let numbered = (2..).map(|number: u64| format!("{stem}-{number}"));
        let name = std::iter::once(stem.clone()).chain(numbered).find(|name| !taken.contains(name)).unwrap_or(stem);
        taken.insert(name.clone());
        name
    };
    images.iter().map(&mut free).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_names_are_numbered() {
        let images = ["a/x.png", "b/x.jpg", "x-2.png", "x.png", ".."].map(PathBuf::from);
        assert_eq!(names_of(&images), ["x", "x-2", "x-2-2", "x-3", "picture"]);
    }
}
