use std::io::IsTerminal;
use std::path::{Path, PathBuf};

use serde_json::json;

use super::args::{CalibrateArgs, Common};
use super::failure::Failure;
use super::progress::StageProgress;
use super::{INTERRUPTED, print_json, stop_on_interrupt};
use upm_control::calibration::CalibrationFault;
use upm_core::units::mm_from_m;
use upm_library::Library;
use upm_runner::config::RigSpec;
use upm_runner::run::{calibrate as calibrate_rig, calibration_params};

pub(super) fn calibrate(args: &CalibrateArgs, common: Common) -> Result<u8, Failure> {
    let rig = RigSpec::load(&args.rig).map_err(Failure::faults)?;
    // found out before a long measurement, not after it
    let draft = draft_beside(&args.out).map_err(|error| Failure::write(&args.out, error))?;
    let stop = stop_on_interrupt();
    let progress = StageProgress::new(common.quiet || !std::io::stderr().is_terminal());
    let params = calibration_params(&rig);
    let library = calibrate_rig(&rig, args.seed, &params, &stop, &mut |step| progress.show(step));
    progress.finish();
    let library = match library {
        Ok(library) => library,
        Err(fault) => {
            std::fs::remove_file(&draft).ok();
            if fault == CalibrationFault::Stopped {
                return Ok(INTERRUPTED);
            }
            return Err(Failure::failed(format!("calibration of {}: {fault}", rig.model.name)));
        }
    };
    library
        .save(&draft)
        .and_then(|()| std::fs::rename(&draft, &args.out))
        .map_err(|error| Failure::write(&args.out, error))?;
    if common.json {
        print_json(
            &json!({ "rig": library.rig, "fingerprint": library.fingerprint, "entries": library.entries.len() }),
        )?;
    } else {
        print_summary(&library)?;
        say!("  {:18} {}", "written to", args.out.display())?;
    }
    Ok(0)
}

/// An empty file beside `out` that the library is written to before it takes its place.
fn draft_beside(out: &Path) -> std::io::Result<PathBuf> {
    let mut name = out.file_name().unwrap_or_default().to_owned();
    name.push(".part");
    let draft = out.with_file_name(name);
    std::fs::File::create(&draft)?;
    Ok(draft)
}

fn print_summary(library: &Library) -> Result<(), Failure> {
    say!("{}: {} motions measured", library.rig, library.entries.len())?;
    let model = &library.displacement;
    let (Some(slow), Some(fast)) = (model.speed_mps.first(), model.speed_mps.last()) else { return Ok(()) };
    say!("  {:18} {:.0} to {:.0} mm/s under the coins", "plate speeds", mm_from_m(*slow), mm_from_m(*fast))?;
    let range = [model.min_distance(*fast), model.max_distance(*fast)].map(mm_from_m);
    say!("  {:18} {:.2} to {:.1} mm at the fastest", "steps", range[0], range[1])
}
