use std::path::PathBuf;

use nalgebra::Vector3;
use serde_json::json;
use sha2::{Digest, Sha256};

use super::kinds::{KindSpec, kinds_of};
use super::read::{Origin, point_m};
use super::rig_checks;
use super::rig_file::{FieldSection, RigFile};
use super::rig_source::RigSource;
use upm_core::document::{Diagnostic, Diagnostics, Path, one_of, parse_and_build, quoted, text_of};
use upm_core::geometry::{Lens, Vec2};
use upm_core::rig::{FieldDriveModel, RigModel};
use upm_core::units::m_from_mm;
use upm_sim::{AccelerometerParams, CameraParams, ContactParams, MotorParams, PlateParams, SimParams};

/// Validated rig file. `model` holds the properties that control may know; the rest is for the simulation.
#[derive(Clone, Debug, PartialEq)]
pub struct RigSpec {
    /// Contents of the file with all defaults written out.
    pub document: RigFile,
    /// Properties that can be measured or are in a data sheet.
    pub model: RigModel,
    /// Parameters of the simulated rig.
    pub sim: SimParams,
    /// Kinds of part: the four coins, then the rig's kinds by name.
    pub kinds: Vec<KindSpec>,
    /// Path of its COR library, if it names one.
    pub library: Option<PathBuf>,
    /// Key that names the library, for faults: `rig upm-1.json: library`.
    pub library_key: String,
    /// First 16 hex digits of SHA-256 over the parts of the rig that a COR library depends on.
    pub fingerprint: String,
}

impl RigSpec {
    /// Reads and validates the rig file at `path`. Errors list every fault.
    pub fn load(path: &std::path::Path) -> Result<Self, Vec<Diagnostic>> {
        Self::from_json(&text_of(path)?, &Origin::of_file(path))
    }

    /// Validates the rig in `text`. Errors list every fault.
    pub fn from_json(text: &str, origin: &Origin) -> Result<Self, Vec<Diagnostic>> {
        parse_and_build(text, &origin.file, |document, faults| Self::build(document, origin, &Path::root(), faults))
    }

    /// The shipped weak prototype, without its library, which is a separate file; the rig is compiled into the program.
    pub fn upm_1() -> Result<Self, Vec<Diagnostic>> {
        Self::shipped("configs/rigs/upm-1.json", include_str!("../../../configs/rigs/upm-1.json"))
    }

    /// The shipped strong rig, without its library.
    pub fn upm_2() -> Result<Self, Vec<Diagnostic>> {
        Self::shipped("configs/rigs/upm-2.json", include_str!("../../../configs/rigs/upm-2.json"))
    }

    fn shipped(file: &str, text: &str) -> Result<Self, Vec<Diagnostic>> {
        let origin = Origin::of_request(file);
        parse_and_build(text, file, |document: RigFile, faults| {
            Self::build(RigFile { library: None, ..document }, &origin, &Path::root(), faults)
        })
    }

    /// The rig that `source` at `at` names or contains. Faults in the rig's file carry that file's name.
    pub(super) fn from_source(source: RigSource, origin: &Origin, at: &Path, faults: &mut Diagnostics) -> Option<Self> {
        let named = match source {
            RigSource::Inline(document) => return Self::build(*document, origin, at, faults),
            RigSource::File(named) => named,
        };
        let Some(path) = origin.resolve(&named) else {
            faults.push(at, quoted(&named), "the rig itself (files cannot be named here)");
            return None;
        };
        let rig = Self::load(&path).map(|rig| rig.rebased_from(&named));
        rig.map_err(|others| faults.append_named(others, &format!("{}: {at}", origin.file))).ok()
    }

    /// The same rig as part of a file that calls it `named`: its paths become relative to that file.
    fn rebased_from(mut self, named: &str) -> Self {
        let folder = std::path::Path::new(named).parent();
        if let (Some(folder), Some(library)) = (folder, &mut self.document.library) {
            *library = folder.join(&library).to_string_lossy().into_owned();
        }
        self
    }

    fn build(mut document: RigFile, origin: &Origin, at: &Path, faults: &mut Diagnostics) -> Option<Self> {
        let before = faults.len();
        fill_in(&mut document);
        let kinds = kinds_of(&document, at, faults);
        let sim = sim_params(&document);
        rig_checks::check(&document, &sim, at, faults);
        let at_library = at.key("library");
        let library = document.library.as_ref().and_then(|named| origin.named_file(named, &at_library, faults));
        let is_whole = *at == Path::root();
        let library_key =
            if is_whole { format!("rig {}: library", origin.file) } else { format!("{}: {at}.library", origin.file) };
        let (model, fingerprint) = (model_of(&document, &sim), fingerprint(&document));
        (faults.len() == before).then_some(Self { document, model, sim, kinds, library, library_key, fingerprint })
    }

    /// True if `document`, with defaults written out, equals this rig except for the library it names. A rig without
    /// knocks leaves them to this one.
    pub(super) fn is_as_in(&self, document: &RigFile) -> bool {
        let mut compared = RigFile { library: self.document.library.clone(), ..document.clone() };
        compared.simulation.knocks = compared.simulation.knocks.or_else(|| self.document.simulation.knocks.clone());
        fill_in(&mut compared);
        compared == self.document
    }

    /// Index in [`RigSpec::kinds`] of the kind called `name`.
    pub fn kind(&self, name: &str) -> Option<usize> {
        self.kinds.iter().position(|spec| spec.kind.name == name)
    }

    /// As [`RigSpec::kind`]; an unknown kind is a fault that lists the known ones.
    pub(super) fn known_kind(&self, name: &str, at: &Path, faults: &mut Diagnostics) -> Option<usize> {
        let found = self.kind(name);
        if found.is_none() {
            let names: Vec<&str> = self.kinds.iter().map(|spec| spec.kind.name.as_str()).collect();
            faults.push(at, quoted(name), one_of(name, &names));
        }
        found
    }
}

/// Fills in the defaults that depend on other values.
fn fill_in(document: &mut RigFile) {
    let side_m = m_from_mm(document.plate.side_mm);
    document.plate.inertia_kg_m2.get_or_insert(document.plate.mass_kg * side_m * side_m / 6.0);
    document.camera.principal_px.get_or_insert(document.camera.size_px.map(|size| (size as f64 - 1.0) / 2.0));
}

fn sim_params(document: &RigFile) -> SimParams {
    let RigFile { plate, motors, accelerometers, .. } = document;
    SimParams {
        step_s: document.simulation.step_s,
        plate: PlateParams {
            side_m: m_from_mm(plate.side_mm),
            mass_kg: plate.mass_kg,
            inertia_kgm2: plate.inertia_kg_m2.unwrap_or_default(),
            resonance_hz: [plate.resonance_hz.x, plate.resonance_hz.y, plate.resonance_hz.spin],
            damping_ratio: [plate.damping_ratio.x, plate.damping_ratio.y, plate.damping_ratio.spin],
        },
        motors: MotorParams {
            lever_arm_m: m_from_mm(motors.lever_arm_mm),
            arrangement: motors.arrangement,
            newtons_per_count: motors.newtons_per_count,
            gain_error: motors.gain_error,
            sample_hz: motors.sample_hz,
            count_limit: f64::from(motors.count_limit),
            low_pass_hz: motors.low_pass_hz,
            force_limit_n: motors.force_limit_n,
        },
        accelerometers: AccelerometerParams {
            position_m: point_m(accelerometers.position_mm),
            sample_hz: accelerometers.sample_hz,
            bits: accelerometers.bits,
            range_mps2: accelerometers.range_mps2,
            noise_mps2: accelerometers.noise_mps2,
            bias_sd_mps2: accelerometers.bias_sd_mps2,
            gain_sd: accelerometers.gain_sd,
        },
        camera: camera_params(document),
        contact: ContactParams { restitution: document.friction.restitution, rim_friction: document.friction.rim },
    }
}

fn camera_params(document: &RigFile) -> CameraParams {
    let camera = &document.camera;
    CameraParams {
        size_px: camera.size_px,
        frame_hz: camera.frame_hz,
        exposure_s: camera.exposure_s,
        lens: Lens {
            focal_px: camera.focal_px,
            principal_px: Vec2::from(camera.principal_px.unwrap_or_default()),
            radial: camera.radial,
            tangential: camera.tangential,
        },
        position_m: Vector3::from(camera.position_mm.map(m_from_mm)),
        tilt_rad: camera.tilt_deg.map(f64::to_radians),
        blur_px: camera.blur_px,
        levels: [camera.levels.ground, camera.levels.plate, camera.levels.part],
        shading: camera.shading,
        shading_direction_rad: camera.shading_direction_deg.to_radians(),
        full_well_e: camera.full_well_e.unwrap_or(f64::INFINITY),
        read_noise: camera.read_noise,
    }
}

fn model_of(document: &RigFile, sim: &SimParams) -> RigModel {
    RigModel {
        name: document.name.clone(),
        plate_side_m: sim.plate.side_m,
        lever_arm_m: sim.motors.lever_arm_m,
        motor_arrangement: sim.motors.arrangement,
        plate_mass_kg: sim.plate.mass_kg,
        plate_inertia_kgm2: sim.plate.inertia_kgm2,
        newtons_per_count: sim.motors.newtons_per_count,
        count_limit: sim.motors.count_limit,
        base_radps: std::f64::consts::TAU * document.drive.base_hz,
        attack_s: document.drive.attack_s,
        rest_s: document.drive.rest_s,
        max_sustain_s: document.drive.max_sustain_s,
        fields: document.fields.as_ref().map(field_drive_of),
        accelerometer_in_plate_m: sim.accelerometers.position_m,
        frame_size_px: sim.camera.size_px,
        frame_hz: sim.camera.frame_hz,
        exposure_s: sim.camera.exposure_s,
        lens: sim.camera.lens,
        dark_parts: document.camera.levels.part < document.camera.levels.plate,
    }
}

fn field_drive_of(document: &FieldSection) -> FieldDriveModel {
    FieldDriveModel {
        base_radps: std::f64::consts::TAU * document.base_hz,
        harmonics: document.harmonics,
        attack_s: document.attack_s,
        rest_s: document.rest_s,
    }
}

/// First 16 hex digits of SHA-256 over the canonical JSON (keys sorted, no spaces, defaults written out) of `plate`,
/// `motors`, `drive`, `accelerometers` and, where there are any, `fields`: the properties that a measured COR library
/// depends on. Camera, friction, kinds, step, name and library are left out, since a library remains valid with another
/// camera and another coin.
fn fingerprint(rig: &RigFile) -> String {
    let RigFile { accelerometers, drive, motors, plate, .. } = rig;
    // the members of a value are sorted by their keys
    let mut sections = json!({ "accelerometers": accelerometers, "drive": drive, "motors": motors, "plate": plate });
    if let Some(fields) = &rig.fields {
        sections["fields"] = json!(fields);
    }
    Sha256::digest(sections.to_string()).iter().take(8).map(|byte| format!("{byte:02x}")).collect()
}
