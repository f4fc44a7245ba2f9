use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::read::NAME_PATTERN;
use upm_core::job::CameraMode;

/// A campaign: a job whose values are drawn by seed, or take several values in turn, and the seeds.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(title = "campaign")]
pub struct CampaignFile {
    /// Name of the campaign and of its folder.
    #[schemars(length(min = 1, max = 64), extend("pattern" = NAME_PATTERN))]
    pub(crate) name: String,
    /// Seeds of each cell: `1..1000` (both ends included), `1,5,9` or `1..3,7`.
    pub(crate) seeds: String,
    /// Pictures or positions from the simulated camera. Left out: positions.
    #[serde(default = "positions")]
    pub(crate) camera: CameraMode,
    /// The job, or the path of its file relative to this one. Any value in it may be a draw: `{"$each": [...]}` makes a
    /// cell for each value; by the seed, `{"$one_of": [...]}` is one of the values, `{"$uniform": [a, b]}`,
    /// `{"$log_uniform": [a, b]}` and `{"$integer": [a, b]}` a number, `{"$plus": ["from_s", number]}` a sum with
    /// another member of the same object, `{"$places": {"apart_mm": a, "within_mm": b}}` a place for each part, and
    /// `{"$faults": {"most": n, "until_s": s}}` faults of any kinds.
    #[schemars(schema_with = "job_or_path")]
    pub(crate) job: Value,
}

fn positions() -> CameraMode {
    CameraMode::Positions
}

fn job_or_path(_: &mut schemars::SchemaGenerator) -> schemars::Schema {
    schemars::json_schema!({ "type": ["object", "string"] })
}
