//! `upm lab all`: every experiment as it was published, one after another.

use serde_json::json;

use super::{Made, make};
use crate::cli::args::{Common, LabArgs};
use crate::cli::failure::Failure;
use crate::cli::print_json;
use upm_lab::EXPERIMENTS;

/// Name that stands for all experiments.
pub(super) const ALL: &str = "all";

/// Makes every experiment; figures and series of all in one JSON document, or a table each.
pub(super) fn all(args: &LabArgs, common: Common) -> Result<u8, Failure> {
    let given = [
        ("--set", !args.set.is_empty()),
        ("--sweep", args.sweep.is_some()),
        ("--settings", args.settings),
        ("--scenes", args.scenes.is_some()),
        ("--trace", args.trace.is_some()),
        ("--plot", args.plot.is_some()),
    ];
    if let Some((option, _)) = given.iter().find(|(_, is_given)| *is_given) {
        let allowed = "the name of one experiment";
        return Err(Failure::bad_input(format!("{option}: found experiment {ALL:?}, allowed: {allowed}")));
    }
    let mut rows = Vec::new();
    for experiment in EXPERIMENTS {
        let made: Made = make(experiment.name, args, common)?;
        if common.json {
            rows.push(made.as_json());
        } else {
            made.print()?;
        }
    }
    if common.json {
        print_json(&json!({ "seed": args.seed, "experiments": rows }))?;
    }
    Ok(0)
}
