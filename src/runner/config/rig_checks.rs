use super::read::{NAMES, is_name};
use super::rig_file::RigFile;
use super::view;
use upm_core::document::{Diagnostics, Path};
use upm_core::geometry::Vec2;
use upm_core::units::{GRAVITY_MPS2, mm_from_m, written_hertz, written_mm};
use upm_sim::SimParams;

/// Most pixels of a frame in which the table is searched.
const MOST_PIXELS: usize = 64_000_000;

/// Largest ratio of two sides of the plate in the frame. The search takes 1.4 for a square seen obliquely; the rest is
/// for the plate's swing.
const SIDE_RATIO: f64 = 1.35;

/// Consistency checks between the numbers of a rig, beyond the range of each.
pub(super) fn check(rig: &RigFile, sim: &SimParams, at: &Path, faults: &mut Diagnostics) {
    faults.require(is_name(&rig.name), at.key("name"), format!("{:?}", rig.name), NAMES);
    check_plate(rig, at, faults);
    check_motors(rig, at, faults);
    let base_hz = written_hertz(rig.drive.base_radps);
    let (found, least) = (rig.drive.max_sustain_s, 3.0 / base_hz);
    let allowed = format!("{least:.4} or more (three periods of the drive, for the accelerometers to be read)");
    faults.require(found >= least, at.key("drive").key("max_sustain_s"), found, allowed);
    check_fields(rig, at, faults);
    check_accelerometers(rig, at, faults);
    check_camera(rig, sim, at, faults);
    let push_m = rig.simulation.knocks.as_ref().map(|knocks| knocks.push_m);
    let at_push = at.key("simulation").key("knocks").key("push_mm");
    faults.require(push_m != Some(Vec2::zeros()), at_push, "[0, 0]", "a push along x or y, or no knocks");
    let step_s = rig.simulation.step_s;
    let longest_s = (0.01 / base_hz).min(1.0 / rig.motors.sample_hz).min(1.0 / rig.accelerometers.sample_hz);
    let allowed =
        format!("up to {longest_s} (a hundredth of the drive's period, one sample of motors and accelerometers)");
    faults.require(step_s <= longest_s * (1.0 + 1e-9), at.key("simulation").key("step_s"), step_s, allowed);
}

fn check_plate(rig: &RigFile, at: &Path, faults: &mut Diagnostics) {
    let (plate, base_hz) = (&rig.plate, written_hertz(rig.drive.base_radps));
    let at = at.key("plate");
    let (inertia, most) = (plate.inertia_kgm2, 0.5 * plate.mass_kg * plate.side_m * plate.side_m);
    let allowed = format!("up to {most} (all mass in the corners, M L²/2)");
    faults.require(inertia <= most, at.key("inertia_kg_m2"), inertia, allowed);
    for (axis, found) in ["x", "y", "spin"].into_iter().zip(plate.resonance_hz) {
        let allowed = format!("below drive.base_hz, {base_hz} (above resonance velocity is the force's integral)");
        faults.require(found < base_hz, at.key("resonance_hz").key(axis), found, allowed);
    }
}

fn check_motors(rig: &RigFile, at: &Path, faults: &mut Diagnostics) {
    let (motors, base_hz) = (&rig.motors, written_hertz(rig.drive.base_radps));
    let at = at.key("motors");
    let [reach_mm, arm_mm] = [0.5 * rig.plate.side_m, motors.lever_arm_m].map(written_mm);
    let allowed = format!("up to {reach_mm} (half the plate's side)");
    faults.require(arm_mm <= reach_mm, at.key("lever_arm_mm"), arm_mm, allowed);
    let least_hz = 8.0 * base_hz;
    let allowed = format!("above {least_hz} (four times the second harmonic)");
    faults.require(motors.sample_hz > least_hz, at.key("sample_hz"), motors.sample_hz, allowed);
    let (low_pass, top) = (motors.low_pass_hz, 0.5 * motors.sample_hz);
    faults.require(
        low_pass > 2.0 * base_hz && low_pass < top,
        at.key("low_pass_hz"),
        low_pass,
        format!("above {} (the second harmonic must pass) and below {top} (half the sample rate)", 2.0 * base_hz),
    );
    check_force(rig, &at, faults);
    let (found, limit_n) = (motors.newtons_per_count, motors.force_limit_n);
    faults.require(found <= limit_n, at.key("newtons_per_count"), found, format!("up to force_limit_n, {limit_n}"));
}

/// Reports motors too weak for friction: two coils of an axis at their limit must accelerate the plate enough for a
/// part to slide.
fn check_force(rig: &RigFile, at: &Path, faults: &mut Diagnostics) {
    let (motors, plate_kg) = (&rig.motors, rig.plate.mass_kg);
    let hold_mps2 = rig.friction.coefficient * GRAVITY_MPS2;
    let (least_n, full_counts) = (0.5 * plate_kg * hold_mps2, motors.count_limit);
    let rounded_up = |newtons: f64| (newtons * 1e6).ceil() / 1e6;
    let why = format!("less does not slide a part: two coils on {plate_kg} kg against friction of {hold_mps2:.2} m/s²");
    let allowed = format!("{} or more ({why})", rounded_up(least_n / full_counts));
    let is_strong = motors.newtons_per_count * full_counts >= least_n;
    faults.require(is_strong, at.key("newtons_per_count"), motors.newtons_per_count, allowed);
    let allowed = format!("{} or more ({why})", rounded_up(least_n));
    faults.require(motors.force_limit_n >= least_n, at.key("force_limit_n"), motors.force_limit_n, allowed);
}

/// Checks that synthesised motions drive the plate above resonance, pass the low-pass, and are sampled densely enough.
fn check_fields(rig: &RigFile, at: &Path, faults: &mut Diagnostics) {
    let (Some(fields), at) = (&rig.fields, at.key("fields")) else { return };
    let base_hz = written_hertz(fields.base_radps);
    let stiffest_hz = rig.plate.resonance_hz.into_iter().fold(0.0, f64::max);
    let allowed = format!("above {stiffest_hz}, the highest of plate.resonance_hz");
    faults.require(base_hz > stiffest_hz, at.key("base_hz"), base_hz, allowed);
    let (least_hz, longest_s) = (3.0 / rig.drive.max_sustain_s, rig.drive.max_sustain_s);
    let allowed = format!("{least_hz:.4} or more (three periods within drive.max_sustain_s, {longest_s})");
    faults.require(base_hz >= least_hz * (1.0 - 1e-9), at.key("base_hz"), base_hz, allowed);
    let (highest_hz, low_pass_hz) = (base_hz * fields.harmonics as f64, rig.motors.low_pass_hz);
    let (motors_hz, read_hz) = (rig.motors.sample_hz / 4.0, rig.accelerometers.sample_hz / 8.0);
    let allowed = format!(
        "a highest harmonic below {} Hz (motors.low_pass_hz, a quarter of motors.sample_hz and an eighth of \
         accelerometers.sample_hz)",
        low_pass_hz.min(motors_hz).min(read_hz),
    );
    let found = format!("{} up to {highest_hz} Hz", fields.harmonics);
    let passes = highest_hz < low_pass_hz && highest_hz < motors_hz && highest_hz < read_hz;
    faults.require(passes, at.key("harmonics"), found, allowed);
    let least_s = 0.5 / base_hz;
    let allowed = format!("{least_s:.6} or more (half a period of fields.base_hz)");
    faults.require(fields.attack_s >= least_s * (1.0 - 1e-4), at.key("attack_s"), fields.attack_s, allowed);
}

fn check_accelerometers(rig: &RigFile, at: &Path, faults: &mut Diagnostics) {
    let at = at.key("accelerometers");
    let (found_hz, least_hz) = (rig.accelerometers.sample_hz, 16.0 * written_hertz(rig.drive.base_radps));
    let allowed = format!("{least_hz} or more (16 samples to a period of the drive)");
    faults.require(found_hz >= least_hz, at.key("sample_hz"), found_hz, allowed);
    let position_m = rig.accelerometers.position_m;
    let [x, y, half] = [position_m.x, position_m.y, 0.5 * rig.plate.side_m].map(written_mm);
    let place = at.key("position_mm");
    for (i, found) in [x, y].into_iter().enumerate() {
        faults.require(found.abs() <= half, place.index(i), found, format!("from -{half} to {half} (on the plate)"));
    }
    let (arm, least) = (libm::hypot(x, y), 0.2 * half);
    let allowed = format!("{least} mm or more from the centre (spin is read from the arm between the two)");
    faults.require(arm >= least, &place, format!("{arm:.3} mm from the centre"), allowed);
    let allowed = format!("{least} mm or more off both axes (on one the gains of x and y cannot be told apart)");
    let off = x.abs().min(y.abs());
    faults.require(arm < least || off >= least, &place, format!("{off:.3} mm off an axis"), allowed);
}

fn check_camera(rig: &RigFile, sim: &SimParams, at: &Path, faults: &mut Diagnostics) {
    let (camera, at) = (&rig.camera, at.key("camera"));
    let period_s = 1.0 / camera.frame_hz;
    let allowed = format!("below {period_s:.6} (one frame's period)");
    faults.require(camera.exposure_s < period_s, at.key("exposure_s"), camera.exposure_s, allowed);
    let [columns, rows] = camera.size_px;
    let allowed = format!("up to {MOST_PIXELS} px in all");
    faults.require(columns * rows <= MOST_PIXELS, at.key("size_px"), format!("{columns} x {rows}"), allowed);
    check_levels(camera.levels, &at.key("levels"), faults);
    let [lowest_mm, z_mm] = [0.5 * rig.plate.side_m, camera.position_m.z].map(written_mm);
    let height = &at.key("position_mm").index(2);
    faults.require(z_mm >= lowest_mm, height, z_mm, format!("{lowest_mm} or more (half the plate's side above it)"));
    let least_px = view::FRAME_MARGIN * camera.size_px[1] as f64;
    match view::margin_px(&sim.camera, sim.plate.side_m) {
        Some(margin) if margin >= least_px => {}
        Some(margin) => {
            let side = if margin < 0.0 { "outside" } else { "inside" };
            let found = format!("its outline {:.1} px {side} the frame's edge", margin.abs());
            faults.push(&at, found, whole_plate_in_view(sim, least_px));
        }
        None => faults.push(&at, "a plate that is not in front of the camera", whole_plate_in_view(sim, least_px)),
    }
    if let Some(ratio) = view::side_ratio(&sim.camera, sim.plate.side_m).filter(|ratio| *ratio > SIDE_RATIO) {
        let allowed = format!("a view in which no side of the plate is longer than {SIDE_RATIO} times another");
        faults.push(at.key("tilt_deg"), format!("a side {ratio:.2} times as long as another"), allowed);
    }
    if !view::is_one_to_one(&sim.camera, sim.plate.side_m) {
        let allowed = format!("a distortion that is one-to-one over the plate of {} mm", mm_from_m(sim.plate.side_m));
        faults.push(at.key("radial"), "a lens that folds the picture", allowed);
    }
}

/// Expected view of a camera for messages, with the height from which it would see the whole plate.
fn whole_plate_in_view(sim: &SimParams, least_px: f64) -> String {
    let height = match view::least_height_m(&sim.camera, sim.plate.side_m, least_px) {
        Some(height_m) => format!("raise it: position_mm[2] of {:.0} would do", mm_from_m(height_m).ceil()),
        None => "no height would do: move or turn it, or take a shorter focal_px".to_owned(),
    };
    format!("the whole plate in view, {least_px:.1} px or more inside the frame ({height})")
}

/// Checks the gray levels. The finder detects parts from 20 % of the plate's level, at most 255, upwards; 60 leaves
/// room for shading and noise. The table is the square whose edges are detected beside the picture's strongest, those
/// of the parts: it is lost if its step is a fifth of theirs, and found if it is a quarter.
fn check_levels([ground, plate, part]: [f64; 3], at: &Path, faults: &mut Diagnostics) {
    const LEAST_PART: f64 = 60.0;
    const LEAST_GROUND: f64 = 40.0;
    const GROUND_SHARE: f64 = 0.3;
    let contrast = (plate - part).abs();
    let allowed = format!("{LEAST_PART} or more away from levels.plate, {plate} (parts must stand out on the plate)");
    faults.require(contrast >= LEAST_PART, at.key("part"), part, allowed);
    let least = LEAST_GROUND.max(GROUND_SHARE * contrast);
    let allowed = format!(
        "{least} or more away from levels.plate, {plate} (the table must stand out from the ground: by {LEAST_GROUND} at \
         least, and by {GROUND_SHARE} of the step from plate to part)"
    );
    faults.require((plate - ground).abs() >= least, at.key("ground"), ground, allowed);
}
