use std::sync::Arc;

use serde_json::{Map, Value, json};

use super::actions::ActionPlanner;
use super::types::{ActionKind, EpisodeTask};
use crate::config::{Diagnostic, JobSpec, Origin, Path, one_of};
use crate::run::{RunError, job_library, planner_params};
use upm_core::document::{counted, shown};
use upm_core::job::CameraMode;
use upm_planning::cor_library::Library;

/// Description of episodes, which many share.
#[derive(Clone, Debug)]
pub struct EpisodeParams {
    /// The job with rig, parts, tolerance and time limit.
    pub job: JobSpec,
    pub(super) library: Arc<Library>,
    /// True if targets are drawn; those of the job's task else.
    pub(super) is_drawn: bool,
    /// Task of the episodes.
    pub task: EpisodeTask,
    /// Meaning of the actions.
    pub action: ActionKind,
    /// Least and largest value of each number of an action.
    pub action_bounds: Vec<[f64; 2]>,
}

impl EpisodeParams {
    /// Reads a job file whose task is `arrange`, `sort` or `stream`, with a key `action`: `motion` (the default),
    /// `pulse` or `steps`. An `arrange` or `stream` of its type alone draws targets as a job draws start places; parts
    /// with a given place stay there. `rig` is `rigs/upm-2.json` unless given.
    ///
    /// # Errors
    /// The faults of the job; a library without the response that the actions need.
    pub fn from_json(text: &str, origin: &Origin) -> Result<Self, RunError> {
        let (file, root) = (&origin.file, Path::root());
        let mut members: Map<String, Value> =
            serde_json::from_str(text).map_err(|error| Diagnostic::syntax(file, &error))?;
        fn text_of(value: &Value) -> &str {
            value.as_str().unwrap_or_default()
        }
        let unknown = |found: &Value, at: Path, known: &[&str]| {
            Diagnostic::new(file, at, shown(found), one_of(text_of(found), known))
        };
        let action = members.remove("action").unwrap_or(ActionKind::Motion.code().into());
        let action = ActionKind::of_code(text_of(&action))
            .ok_or_else(|| unknown(&action, root.key("action"), &ActionKind::ALL.map(ActionKind::code)))?;
        let given = members.get("task").cloned().unwrap_or_default();
        let task = EpisodeTask::of_code(text_of(&given["type"])).ok_or_else(|| {
            unknown(&given["type"], root.key("task").key("type"), &EpisodeTask::ALL.map(EpisodeTask::code))
        })?;
        let is_drawn = task != EpisodeTask::Sort && given.as_object().is_some_and(|keys| keys.len() == 1);
        if is_drawn {
            // the job's checks need a task
            members.insert("task".into(), json!({"type": "hold", "duration_s": 1}));
        } else if task == EpisodeTask::Stream {
            let allowed = "its type alone, since its places are drawn";
            return Err(Diagnostic::new(file, root.key("task"), shown(&given), allowed).into());
        }
        members.entry("name").or_insert("episode".into());
        members.entry("rig").or_insert("rigs/upm-2.json".into());
        let job =
            JobSpec::from_json(&Value::from(members).to_string(), origin, None)?.with_camera(CameraMode::Positions);
        if !job.faults.is_empty() || job.rig.document.simulation.knocks.is_some() {
            return Err(Diagnostic::new(file, "faults", "some", "none, and no knocks of the rig, in an episode").into());
        }
        let mut params = Self { library: job_library(&job)?, job, is_drawn, task, action, action_bounds: Vec::new() };
        params.action_bounds = params.planner()?.bounds(params.parts(), params.job.rig.model.plate_side_m);
        Ok(params)
    }

    /// Planner of a new episode.
    pub(super) fn planner(&self) -> Result<ActionPlanner, Diagnostic> {
        ActionPlanner::new(self.action, &self.library, planner_params(&self.job.rig.model)).ok_or_else(|| {
            let expected = "pulse, since the library has no response to synthesised fields";
            Diagnostic::new(&self.job.file, "action", self.action.code(), expected)
        })
    }

    /// Number of parts.
    pub fn parts(&self) -> usize {
        self.job.kinds_of_parts().len()
    }

    /// Numbers of an observation: positions, mm, targets, mm, and mean velocities over the last step, mm/s, of all
    /// parts, for each part x and y.
    pub fn observation_len(&self) -> usize {
        6 * self.parts()
    }

    /// `Err` for actions of `episodes` episodes that are not whole, or with a number out of its bounds.
    pub(super) fn check_actions(&self, actions: &[f64], episodes: usize) -> Result<(), Diagnostic> {
        let wanted = episodes * self.action_bounds.len();
        if actions.len() != wanted {
            return Err(Diagnostic::new("action", Path::root(), counted(actions.len(), "number"), wanted.to_string()));
        }
        let bounds = self.action_bounds.iter().cycle();
        for (i, (value, [least, most])) in actions.iter().zip(bounds).enumerate() {
            let is_number = self.action == ActionKind::Pulse && i % 2 == 0;
            if !(*least..=*most).contains(value) || is_number && value.fract() != 0.0 {
                let allowed = format!("{}from {least} to {most}", if is_number { "a whole number " } else { "" });
                return Err(Diagnostic::new("action", Path::root().index(i), value, allowed));
            }
        }
        Ok(())
    }
}
