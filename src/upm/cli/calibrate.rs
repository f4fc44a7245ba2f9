use serde_json::json;

use super::args::{CalibrateArgs, Common};
use super::output::{Failure, INTERRUPTED, NOT_REACHED, print, stop_on_interrupt};
use super::progress::LateProgress;
use upm_control::calibration::{CalibrationError, CalibrationProgress};
use upm_core::units::mm_from_m;
use upm_planning::cor_library::Library;
use upm_runner::config::RigSpec;
use upm_runner::run::{LibraryOutput, calibrate as calibrate_rig, calibration_params};

pub(super) fn calibrate(args: &CalibrateArgs, common: Common) -> Result<u8, Failure> {
    let rig = RigSpec::load(&args.rig).map_err(Failure::of_files)?;
    // checked before the long measurement
    let output = LibraryOutput::check(&args.out)?;
    let stop = stop_on_interrupt();
    let mut progress = LateProgress::new(common);
    let params = calibration_params(&rig);
    let library = calibrate_rig(&rig, args.seed, &params, &stop, &mut |step| show(&mut progress, step));
    progress.finish();
    let library = match library {
        Ok(library) => library,
        Err(CalibrationError::Stopped) => return Ok(INTERRUPTED),
        Err(fault) => return Err(Failure::failed(format!("calibration of {}: {fault}", rig.model.name))),
    };
    let replaced = output.replace(&library, &rig);
    replaced.map_err(|error| Failure { status: NOT_REACHED, ..error.into() })?;
    let summary = json!({ "rig": library.rig, "fingerprint": library.fingerprint, "entries": library.entries.len() });
    print(common.json, &summary, || {
        print_summary(&library)?;
        outln!("  {:18} {}", "written to", args.out.display())
    })
}

fn show(shown: &mut LateProgress, progress: CalibrationProgress) {
    let CalibrationProgress { stage, done, total, plate_time_s } = progress;
    let share = done as f64 / total.max(1) as f64;
    shown.show(share, || format!("plate {plate_time_s:6.1} s  {stage} {done} of {total}"));
}

fn print_summary(library: &Library) -> Result<(), Failure> {
    outln!("{}: {} motions measured", library.rig, library.entries.len())?;
    let model = &library.displacement;
    let (Some(slow), Some(fast)) = (model.speed_mps.first(), model.speed_mps.last()) else { return Ok(()) };
    outln!("  {:18} {:.0} to {:.0} mm/s under the coins", "plate speeds", mm_from_m(*slow), mm_from_m(*fast))?;
    let range = [model.min_distance(*fast), model.max_distance(*fast)].map(mm_from_m);
    outln!("  {:18} {:.2} to {:.1} mm at the fastest", "steps", range[0], range[1])?;
    let Some(noise) = &library.camera_noise else { return Ok(()) };
    let (px, mm) = (noise.corner_px, mm_from_m(noise.place_m));
    outln!("  {:18} {px:.3} px at the plate's corners, {mm:.4} mm in a coin's place", "camera noise")
}
