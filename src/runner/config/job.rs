use serde_json::Value;

use super::clearance;
use super::drawings;
use super::faults::{self, fault_entry};
use super::job_file::{DeadlinePolicy, JobFile, LibraryRef, PartsEntry, PathEntry, TaskSection};
use super::kinds::{PartGroup, each_kind, part_ids};
use super::names::check_names;
use super::planner_checks::check_planner;
use super::read::{NAMES, Origin, is_name};
use super::rig::RigSpec;
use super::rig_file::RigSource;
use super::task::{self, TaskSpec};
use upm_core::document::{Diagnostic, Diagnostics, Path, counted, parse_and_build_rest, text_of};
use upm_core::job::{CameraMode, Finding};
use upm_core::rig::PartKind;
use upm_core::units::mm_from_m;
use upm_sim::faults::FaultSpec;

/// Validated job file: rig, parts, task, planner and limits.
#[derive(Clone, Debug, PartialEq)]
pub struct JobSpec {
    /// Name of the file in faults.
    pub file: String,
    /// Name of the job, valid as a folder name.
    pub name: String,
    /// Rig that the job names, else that of the daemon's plate.
    pub rig: RigSpec,
    /// COR library: the job's own, else the rig's.
    pub library: Option<LibraryRef>,
    /// Groups of parts, as in the file.
    pub parts: Vec<PartGroup>,
    /// Goal of the run: a plus sign, trajectories, an arrangement, bins or a hold; the last one of several.
    pub task: TaskSpec,
    /// Goals before it, in order.
    pub earlier: Vec<TaskSpec>,
    /// Distance from the target at which a part has arrived, m.
    pub tolerance_m: f64,
    /// Largest plate time of the run, s.
    pub plate_time_limit_s: f64,
    /// Simulated faults.
    pub faults: Vec<FaultSpec>,
    /// Pictures or positions from the simulated camera; not in the file, but chosen for a run.
    pub camera: CameraMode,
    /// Seed of the start places, where it is not the job's.
    placement_seed: Option<u64>,
    /// Code of a disabled guard; set only by builds with the feature `mutants`.
    pub without_guard: Option<Finding>,
    /// Policy for a computer that is too slow for the plate.
    pub deadlines: DeadlinePolicy,
    /// Warnings of what is in its drawings beside paths.
    pub warnings: Vec<Diagnostic>,
    /// Contents of the file with all defaults written out, without the rig.
    pub(crate) document: JobFile,
}

impl JobSpec {
    /// Reads and validates the job file at `path` and the rig it names. Errors list every fault.
    pub fn load(path: &std::path::Path) -> Result<Self, Vec<Diagnostic>> {
        Self::from_json(&text_of(path)?, &Origin::of_file(path), None)
    }

    /// Validates the job in `text`. `plate_rig` is the default rig; a rig written out in the job must be equal to it.
    /// Errors list every fault.
    pub fn from_json(text: &str, origin: &Origin, plate_rig: Option<&RigSpec>) -> Result<Self, Vec<Diagnostic>> {
        parse_and_build_rest(text, &origin.file, |document, faults| Self::build(document, origin, plate_rig, faults))
    }

    fn build(
        mut document: JobFile,
        origin: &Origin,
        plate_rig: Option<&RigSpec>,
        faults: &mut Diagnostics,
    ) -> Option<Self> {
        let root = Path::root();
        faults.require(is_name(&document.name), root.key("name"), format!("{:?}", document.name), NAMES);
        for (i, group) in document.parts.iter().enumerate() {
            let alone = group.position_m.is_none() || group.count == 1;
            let at = root.key("parts").index(i).key("position_mm");
            faults.require(alone, &at, format!("a position for {} parts", group.count), "a position only with count 1");
        }
        // path data replaces a drawing's file, so that a run folder needs no other file
        let warnings = drawings::write_out(&mut document, origin, faults);
        let library = library_of(&document, origin, faults);
        let at = root.key("rig");
        let rig = match (document.rig.take(), plate_rig) {
            (Some(RigSource::Inline(document_rig)), Some(rig)) => {
                // the library of the rig is not compared, since the plate chooses it
                let plate = document.plate.as_ref().map_or("the plate".to_owned(), |name| format!("plate {name}"));
                let allowed = format!("the rig of {plate}, or nothing");
                faults.require(rig.is_as_in(&document_rig), at, "another rig", allowed).then(|| rig.clone())?
            }
            (Some(source), _) => RigSpec::from_source(source, origin, &at, faults)?,
            (None, Some(rig)) => rig.clone(),
            (None, None) => {
                faults.push_missing(&at, "a path or a rig object");
                return None;
            }
        };
        check_knocks(&rig, document.limits.plate_time_s, faults);
        if faults.are_sound(&["task", "tasks"]) {
            check_planner(&document, &rig, &root, faults);
        }
        let parts = groups_of(&document, &rig, faults);
        if !faults.are_sound(&["parts"]) || !clearance::check_total(&parts, faults) {
            return None;
        }
        check_names(&parts, &rig, faults);
        check_distinguishable(&parts, &rig, faults);
        let tasks = tasks_of(&document, &parts, &rig, faults);
        clearance::check(&parts, &rig, faults);
        let at = root.key("faults");
        let ids = part_ids(&parts, &rig.kinds);
        let of_rig = document.faults.as_ref().map(|list| faults::build(list, &ids, &at, faults));
        document.faults = of_rig.as_ref().map(|specs| specs.iter().map(fault_entry).collect());
        if !faults.is_empty() {
            faults.append(warnings.clone());
        }
        let (task, earlier) = tasks?;
        Some(Self {
            file: origin.file.clone(),
            name: document.name.clone(),
            library: library.or_else(|| rig.library.clone().map(LibraryRef::File)),
            parts,
            task,
            earlier,
            tolerance_m: document.tolerance_m,
            plate_time_limit_s: document.limits.plate_time_s,
            faults: of_rig.unwrap_or_default(),
            camera: CameraMode::default(),
            placement_seed: None,
            without_guard: None,
            deadlines: document.deadlines,
            warnings,
            rig,
            document,
        })
    }

    /// As [`Self::load`], on `rig` in place of the one that the file names.
    pub fn load_on(path: &std::path::Path, rig: &RigSpec) -> Result<Self, Vec<Diagnostic>> {
        let (text, origin) = (text_of(path)?, Origin::of_file(path));
        parse_and_build_rest(&text, &origin.file, |document: JobFile, faults| {
            Self::build(JobFile { rig: None, ..document }, &origin, Some(rig), faults)
        })
    }

    /// True if only the plate time limit ends the task, which completes it.
    pub fn is_endless(&self) -> bool {
        self.document.repeat == 0 || self.task.is_endless(self.plate_time_limit_s)
    }

    /// The goals of one round, in order.
    pub fn each_task(&self) -> impl Iterator<Item = &TaskSpec> {
        self.earlier.iter().chain([&self.task])
    }

    /// Place in the file of the path that a part follows in one of the tasks.
    pub(crate) fn path_of(&self, task: usize, part: usize) -> Option<Path> {
        let (at, section) = self.document.each_task().into_iter().nth(task)?;
        let TaskSection::Trajectories { paths, .. } = section else { return None };
        let ids = part_ids(&self.parts, &self.rig.kinds);
        let mut parts = paths.iter().enumerate().flat_map(|(i, path)| std::iter::repeat_n(i, path.parts_on_it()));
        let names = |path: &PathEntry| path.parts.as_ref().is_some_and(|names| names.contains(&ids[part]));
        let path = paths.iter().position(names).or_else(|| parts.nth(part))?;
        Some(at.key("paths").index(path))
    }

    /// True if the job itself has a library, by its file or written out; its rig may name another.
    pub fn names_library(&self) -> bool {
        self.document.library.is_some()
    }

    /// Key that names the library: the job's or its rig's.
    pub fn library_key(&self) -> String {
        if self.names_library() { format!("{}: library", self.file) } else { self.rig.library_key.clone() }
    }

    /// Seed of all random numbers.
    pub fn seed(&self) -> u64 {
        self.document.seed
    }

    /// The same job with another seed.
    pub fn with_seed(mut self, seed: u64) -> Self {
        self.document.seed = seed;
        self
    }

    /// The same job with another seed for all but the start places.
    pub(crate) fn at_the_same_places(mut self, seed: u64) -> Self {
        self.placement_seed = Some(self.placement_seed());
        self.with_seed(seed)
    }

    /// Seed of the start places.
    pub(crate) fn placement_seed(&self) -> u64 {
        self.placement_seed.unwrap_or(self.seed())
    }

    /// The same job with another camera.
    pub fn with_camera(self, camera: CameraMode) -> Self {
        Self { camera, ..self }
    }

    /// The same job with the faults in `texts` added, as typed on the command line.
    ///
    /// # Errors
    /// Every text that is not a valid fault.
    pub fn with_faults(mut self, texts: &[String]) -> Result<Self, Vec<Diagnostic>> {
        let mut faults = Diagnostics::of("--faults");
        let typed = faults::typed(texts, &part_ids(&self.parts, &self.rig.kinds), &mut faults);
        let (total, most) = (self.faults.len() + typed.len(), faults::MOST_FAULTS);
        faults.require(
            total <= most,
            Path::root(),
            counted(total, "fault"),
            format!("up to {most}, the job's included"),
        );
        let typed = faults.into_result(Some(typed))?;
        self.faults.extend(typed);
        if !self.faults.is_empty() {
            self.document.faults = Some(self.faults.iter().map(fault_entry).collect());
        }
        Ok(self)
    }

    /// Kind of each part, as an index into the rig's kinds, in the order of the job.
    pub fn kinds_of_parts(&self) -> Vec<usize> {
        each_kind(&self.parts)
    }

    /// The job with the rig and all defaults written out; reading it with the same origin gives an equal spec.
    pub fn effective(&self) -> Value {
        let rig = Some(RigSource::Inline(Box::new(self.rig.document.clone())));
        serde_json::to_value(JobFile { rig, ..self.document.clone() }).unwrap_or_default()
    }

    /// As [`Self::effective`], without the rig: the form sent to a plate that has the rig.
    pub fn effective_without_rig(&self) -> Value {
        serde_json::to_value(&self.document).unwrap_or_default()
    }
}

/// The last task in SI, and those before it. Faults where one is not feasible, or is followed by another and does not
/// end.
fn tasks_of(
    document: &JobFile,
    parts: &[PartGroup],
    rig: &RigSpec,
    faults: &mut Diagnostics,
) -> Option<(TaskSpec, Vec<TaskSpec>)> {
    if !faults.are_sound(&["task", "tasks"]) {
        return None;
    }
    let root = Path::root();
    let found = if document.task.is_some() { "task and tasks" } else { "none" };
    let is_one = document.task.is_some() != document.tasks.is_some();
    let is_list = document.tasks.is_some() || document.repeat == 1;
    if !faults.require(is_one, root.key("task"), found, "exactly one of task and tasks")
        || !faults.require(is_list, root.key("repeat"), document.repeat, "1 without tasks")
    {
        return None;
    }
    let is_limit_known = faults.are_sound(&["limits", "repeat"]);
    let (limit_s, mut tasks) = (document.limits.plate_time_s, Vec::new());
    for (i, (at, section)) in document.each_task().into_iter().enumerate() {
        let is_last = i + 1 == document.each_task().len() && document.repeat == 1;
        let task = task::build(section, at.clone(), parts, rig, document.planner, faults);
        let is_followed = task.as_ref().is_some_and(|task| !is_last && task.is_endless(limit_s)) && is_limit_known;
        faults.require(!is_followed, at, "a task without end", "one that ends, since another follows it");
        tasks.extend(task);
    }
    let last = tasks.pop()?;
    Some((last, tasks))
}

fn library_of(document: &JobFile, origin: &Origin, faults: &mut Diagnostics) -> Option<LibraryRef> {
    match document.library.as_ref()? {
        LibraryRef::File(named) => {
            let named = named.to_string_lossy();
            origin.named_file(&named, &Path::root().key("library"), faults).map(LibraryRef::File)
        }
        inline => Some(inline.clone()),
    }
}

/// Largest number of knocks in a run.
const MOST_KNOCKS: f64 = 10_000.0;

/// Reports a rig that is knocked too often for a run of `until_s`.
fn check_knocks(rig: &RigSpec, until_s: f64, faults: &mut Diagnostics) {
    let Some(knocks) = &rig.document.simulation.knocks else { return };
    // two knocks are half the mean time apart or more
    let least_s = until_s / (0.5 * MOST_KNOCKS);
    let allowed =
        format!("up to {} ({MOST_KNOCKS} knocks by the rig's simulation.knocks)", 0.5 * MOST_KNOCKS * knocks.every_s);
    faults.require(knocks.every_s >= least_s, Path::root().key("limits").key("plate_time_s"), until_s, allowed);
}

/// The groups with their kinds looked up. A kind that is unknown or larger than the plate is reported and gets an
/// invalid index, so that checks of everything else still run and no consequential faults are reported.
fn groups_of(document: &JobFile, rig: &RigSpec, faults: &mut Diagnostics) -> Vec<PartGroup> {
    let group_of = |(i, group): (usize, &PartsEntry)| {
        let at = Path::root().key("parts").index(i).key("kind");
        let kind = rig.known_kind(&group.kind, &at, faults);
        let at_random = group.position_m.is_none();
        let kind = kind.filter(|&kind| clearance::check_size(kind, rig, at_random, &at, faults));
        let PartsEntry { name, count, position_m, .. } = group.clone();
        PartGroup { kind: kind.unwrap_or(usize::MAX), count: count as usize, name, position_m }
    };
    document.parts.iter().enumerate().map(group_of).collect()
}

/// Least relative difference in diameter, with respect to the larger one, at which a measured radius distinguishes two
/// kinds. The finder assigns a part to the nearest kind, so its error may reach half of this; penny and dime, the
/// closest of the coins, differ by 6 %.
const LEAST_DIAMETER_DIFFERENCE: f64 = 0.03;

/// Reports every kind that the camera cannot distinguish from an earlier kind on the plate.
fn check_distinguishable(groups: &[PartGroup], rig: &RigSpec, faults: &mut Diagnostics) {
    let mut before: Vec<usize> = Vec::new();
    for (i, group) in groups.iter().enumerate() {
        let Some(PartKind { name, radius_m, .. }) = rig.kinds.get(group.kind).map(|spec| &spec.kind) else { continue };
        if before.contains(&group.kind) {
            continue;
        }
        let alike =
            before.iter().filter_map(|&kind| rig.kinds.get(kind)).map(|spec| &spec.kind).find(|other| {
                (radius_m - other.radius_m).abs() < LEAST_DIAMETER_DIFFERENCE * radius_m.max(other.radius_m)
            });
        if let Some(other) = alike {
            let [diameter_mm, other_mm] = [radius_m, &other.radius_m].map(|radius_m| mm_from_m(2.0 * radius_m));
            let found = format!("{name} of {diameter_mm:.3} mm beside {} of {other_mm:.3} mm", other.name);
            let allowed = "kinds whose diameters differ by 3 % or more (the camera tells kinds by size)";
            faults.push(Path::root().key("parts").index(i).key("kind"), found, allowed);
        }
        before.push(group.kind);
    }
}
