//! Journal lines for table and parts located without prior knowledge.

use schemars::JsonSchema;
use serde::Serialize;

use super::fixed::{Fixed, Mm, PointMm, Seconds, fixed_pair, mm, point_mm, points_mm, seconds};
use upm_control::{ConfirmedFacts, LocalisedFacts};

#[derive(Serialize, JsonSchema)]
pub(super) struct LocalisedLine {
    at_s: Seconds,
    corners_px: [[Fixed<3>; 2]; 4],
    side_px: Fixed<3>,
    rotation_deg: Fixed<4>,
    parts: Vec<FoundPart>,
}

#[derive(Serialize, JsonSchema)]
struct FoundPart {
    kind: usize,
    center_px: [Fixed<3>; 2],
    radius_px: Fixed<3>,
    position_mm: PointMm,
    score: Fixed<4>,
}

impl LocalisedLine {
    pub(super) fn new(facts: &LocalisedFacts<'_>) -> Self {
        let parts = facts.detections.iter().map(|part| FoundPart {
            kind: part.kind,
            center_px: fixed_pair(part.center_px),
            radius_px: Fixed(part.radius_px),
            position_mm: point_mm(part.position_m),
            score: Fixed(part.score),
        });
        Self {
            at_s: seconds(facts.frame.exposed_at),
            corners_px: facts.table.corners_px.map(fixed_pair),
            side_px: Fixed(facts.table.side_px),
            rotation_deg: Fixed(facts.table.rotation_rad.to_degrees()),
            parts: parts.collect(),
        }
    }
}

#[derive(Serialize, JsonSchema)]
pub(super) struct ConfirmedLine {
    at_s: Seconds,
    corner_px: Fixed<3>,
    part_mm: Mm,
    parts_mm: Vec<PointMm>,
}

impl ConfirmedLine {
    pub(super) fn new(facts: &ConfirmedFacts<'_>) -> Self {
        Self {
            at_s: seconds(facts.at),
            corner_px: Fixed(facts.corner_px),
            part_mm: mm(facts.part_m),
            parts_mm: points_mm(facts.parts_m),
        }
    }
}
