use std::fs;

use image::GrayImage;
use serde_json::{Value, json};

use super::args::SceneArgs;
use super::failure::Failure;
use upm_core::units::mm_from_m;
use upm_runner::config::{RigFile, RigSpec};
use upm_scene::{Difficulty, Scene, kinds};

/// Draws a scene: its picture, and the files of truth and rig that are asked for; returns the truth as JSON.
pub fn draw(args: &SceneArgs, json: bool) -> Result<String, Failure> {
    let families = Difficulty::ALL.map(Difficulty::code).join(", ");
    let difficulty = Difficulty::of_code(&args.family)
        .ok_or_else(|| Failure::bad_input(format!("expected one of {families}, found {:?}", args.family)))?;
    let scene = Scene::generate(difficulty, args.seed);
    let (frame, truth) = (scene.frame(), format!("{:#}\n", truth(&scene)));
    GrayImage::from_raw(frame.width as u32, frame.height as u32, frame.pixels)
        .ok_or_else(|| Failure::failed("the camera's frame has no picture"))?
        .save(&args.out)
        .map_err(|error| Failure::write(&args.out, error))?;
    let rig = serde_json::to_string_pretty(&rig(&scene)?).map_err(Failure::failed)? + "\n";
    for (path, text) in [(&args.truth, &truth), (&args.rig_out, &rig)] {
        path.iter().try_for_each(|path| fs::write(path, text).map_err(|error| Failure::write(path, error)))?;
    }
    Ok(if json { truth } else { String::new() })
}

fn truth(scene: &Scene) -> Value {
    let kinds = kinds();
    let parts = scene.truth().into_iter().map(|part| {
        json!({
            "kind": kinds.get(part.kind).map(|kind| &kind.name),
            "position_mm": [mm_from_m(part.at_m.x), mm_from_m(part.at_m.y)],
            "center_px": [part.center_px.x, part.center_px.y],
            "radius_px": part.radius_px,
        })
    });
    let corners_px = scene.corners_px().map(|corner| [corner.x, corner.y]);
    json!({ "table": { "corners_px": corners_px }, "parts": parts.collect::<Vec<_>>() })
}

/// The shipped upm-1 with the scene's plate, camera and light. A scene tilts the plate and a rig tilts the camera, so
/// the tilt changes sign.
fn rig(scene: &Scene) -> Result<RigFile, Failure> {
    let mut document = RigSpec::upm_1().map_err(Failure::of_files)?.document;
    document.name = format!("scene-{}", scene.seed);
    // without inertia the file has that of a uniform plate
    (document.plate.side_m, document.plate.inertia_kgm2) = (scene.side_m, 0.0);
    let (lens, camera) = (&scene.lens, &mut document.camera);
    camera.size_px = scene.size_px;
    (camera.focal_px, camera.principal_px) = (lens.focal_px, Some(lens.principal_px.into()));
    (camera.radial, camera.tangential) = (lens.radial, lens.tangential);
    camera.position_m = scene.camera_m;
    camera.tilt_rad = scene.tilt_rad.map(|tilt_rad| -tilt_rad);
    camera.levels = scene.levels;
    (camera.shading, camera.blur_px) = (scene.shading, scene.blur_px);
    Ok(document)
}
