use std::path::PathBuf;

use serde_json::{Value, json};
use sha2::{Digest, Sha256};

use super::kinds::{KindSpec, kinds_of};
use super::read::Origin;
use super::rig_changes::{Chain, RigChanges, rebased};
use super::rig_checks;
use super::rig_file::{RigFile, RigSource};
use upm_core::document::{Diagnostic, Diagnostics, Path, one_of, parse, parse_and_build, quoted, text_of};
use upm_core::rig::RigModel;
use upm_sim::{ContactParams, SimParams};

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
        let chain = Chain::default().with(origin.file.as_ref()).unwrap_or_default();
        Self::extended(text, origin, &chain).map(|(rig, _)| rig)
    }

    /// As [`Self::from_json`], with the rig's whole document: that of the rig which it extends, if it does, with its
    /// changes. `chain` are the files up to this one.
    fn extended(text: &str, origin: &Origin, chain: &Chain) -> Result<(Self, String), Vec<Diagnostic>> {
        let mut whole = text.to_owned();
        if RigChanges::are_in(text) {
            let changes: RigChanges = parse(text, &origin.file)?;
            let base = Self::base(&changes.base(), origin, chain)?;
            whole = changes.applied_to(base).to_string();
        }
        let build = |document, faults: &mut Diagnostics| Self::build(document, origin, &Path::root(), faults);
        parse_and_build(&whole, &origin.file, build).map(|rig| (rig, whole))
    }

    /// The whole document of the rig called `named` that the one of `origin` extends.
    fn base(named: &str, origin: &Origin, chain: &Chain) -> Result<Value, Vec<Diagnostic>> {
        let at = Path::root().key("extends");
        let mut faults = Diagnostics::of(&origin.file);
        let path = origin.named_file(named, &at, &mut faults);
        let path = faults.into_result(path)?;
        let refused = |(found, allowed): (String, String)| vec![Diagnostic::new(&origin.file, &at, found, allowed)];
        let chain = chain.with(&path).map_err(refused)?;
        let whole = text_of(&path).and_then(|text| Self::extended(&text, &Origin::of_file(&path), &chain));
        let by_this = |fault: Diagnostic| match fault.named_by {
            None => fault.named_by(&format!("{}: {at}", origin.file)),
            Some(_) => fault,
        };
        let (_, whole) = whole.map_err(|faults| faults.into_iter().map(by_this).collect::<Vec<_>>())?;
        serde_json::from_str(&whole).map_err(|error| vec![Diagnostic::syntax(named, &error)])
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
        let rig = Self::load(&path);
        let mut rig = rig.map_err(|others| faults.append_named(others, &format!("{}: {at}", origin.file))).ok()?;
        // its paths become relative to the file that names it
        rig.document.library = rig.document.library.map(|library| rebased(&library, &named));
        Some(rig)
    }

    /// The rig file that `changes` make of the one that they extend, within a document from `origin`; what they change
    /// is not checked.
    pub(crate) fn extended_within(
        changes: Value,
        origin: &Origin,
        at: &Path,
        faults: &mut Diagnostics,
    ) -> Option<Value> {
        let changes = serde_json::from_value::<RigChanges>(changes);
        let changes = changes.map_err(|error| faults.push(at, error, "the path of a rig to extend")).ok()?;
        let base = Self::load(&origin.named_file(&changes.base(), &at.key("extends"), faults)?);
        let base = base.map_err(|others| faults.append_named(others, &format!("{}: {at}", origin.file))).ok()?;
        Some(changes.applied_to(json!(base.document)))
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
        let (model, fingerprint) = (model_of(&document), fingerprint(&document));
        (faults.len() == before).then_some(Self { document, model, sim, kinds, library, library_key, fingerprint })
    }

    /// True if `document`, with defaults written out, equals this rig except for the library it names. A rig without
    /// knocks leaves them to this one.
    pub fn is_as_in(&self, document: &RigFile) -> bool {
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
    let (plate, camera) = (&mut document.plate, &mut document.camera);
    if plate.inertia_kgm2 == 0.0 {
        plate.inertia_kgm2 = plate.mass_kg * plate.side_m * plate.side_m / 6.0;
    }
    camera.principal_px = Some(camera.lens().principal_px.into());
}

fn sim_params(document: &RigFile) -> SimParams {
    SimParams {
        step_s: document.simulation.step_s,
        plate: document.plate,
        motors: document.motors,
        accelerometers: document.accelerometers,
        camera: document.camera,
        contact: ContactParams { restitution: document.friction.restitution, rim_friction: document.friction.rim },
    }
}

fn model_of(document: &RigFile) -> RigModel {
    let RigFile { plate, motors, drive, camera, .. } = document;
    let [_, plate_level, part_level] = camera.levels;
    RigModel {
        name: document.name.clone(),
        plate_side_m: plate.side_m,
        lever_arm_m: motors.lever_arm_m,
        motor_arrangement: motors.arrangement,
        plate_mass_kg: plate.mass_kg,
        plate_inertia_kgm2: plate.inertia_kgm2,
        newtons_per_count: motors.newtons_per_count,
        count_limit: motors.count_limit,
        base_radps: drive.base_radps,
        attack_s: drive.attack_s,
        rest_s: drive.rest_s,
        max_sustain_s: drive.max_sustain_s,
        fields: document.fields,
        accelerometer_in_plate_m: document.accelerometers.position_m,
        frame_size_px: camera.size_px,
        frame_hz: camera.frame_hz,
        exposure_s: camera.exposure_s,
        lens: camera.lens(),
        dark_parts: part_level < plate_level,
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
