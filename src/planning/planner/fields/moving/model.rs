//! The planner's knowledge of a rig.

use std::f64::consts::TAU;
use std::sync::Arc;

use crate::cor_library::Library;
use crate::planner::PlannerParams;
use crate::planner::cache::Cache;
use crate::planner::fields::harmonic_basis::HarmonicBasis;
use crate::planner::fields::motor_effort::MotorEffort;
use crate::planner::fields::seeds::SeedLibrary;
use crate::planner::friction::friction_of;
use upm_core::signal::Envelope;

/// Price of a coefficient: a power of its harmonic, and less for spin. The force that it takes would be its first
/// power, but the search would then slide into motions of few low harmonics, whose smooth fields cannot carry many
/// parts each its own way.
const PRICE_POWER: f64 = 0.75;
const SPIN_PRICE: f64 = 0.7;

/// The tables that the planner computes of a library.
#[derive(Debug)]
pub(super) struct MovingModel {
    pub basis: HarmonicBasis,
    pub effort: MotorEffort,
    /// Distance of the motors' lines of action from the plate's centre, m.
    pub lever_arm_m: f64,
    /// Height, slope and curvature of the attack in every phase.
    pub flank: Vec<[f64; 3]>,
    /// Price of each coefficient.
    pub prices: Vec<f64>,
    pub envelope: Envelope,
    pub seeds: SeedLibrary,
    pub friction: f64,
}

static COMPUTED: Cache<(Arc<Library>, PlannerParams), Option<Arc<MovingModel>>> = Cache::new();

impl MovingModel {
    /// The tables for a library, computed once; `None` where it has no fields or no friction.
    pub fn of(library: &Arc<Library>, params: PlannerParams) -> Option<Arc<Self>> {
        Option::clone(&COMPUTED.get((Arc::clone(library), params), Self::new))
    }

    fn new((library, params): &(Arc<Library>, PlannerParams)) -> Option<Arc<Self>> {
        let segments = Library { fields: Some(library.segment_response()?), ..Library::clone(library) };
        let fields = segments.fields.as_ref()?;
        let basis = HarmonicBasis::for_segments(fields.base_radps, fields.twist_from_counts.len(), params.half_side_m);
        let period_s = TAU / fields.base_radps;
        let envelope = Envelope { attack_s: period_s, sustain_s: period_s, rest_s: fields.rest_s };
        let flank = |q: usize| {
            let t_s = (q as f64 + 0.5) / basis.samples as f64 * envelope.attack_s;
            [envelope.at(t_s), envelope.slope(t_s), envelope.curvature(t_s)]
        };
        let price = |j: usize| {
            let of_axis = if j < 2 * basis.per_axis() { 1.0 } else { SPIN_PRICE };
            of_axis * libm::pow(basis.harmonic_of(j) as f64, PRICE_POWER)
        };
        Some(Arc::new(Self {
            effort: MotorEffort::new(&basis, &segments, params.half_side_m)?,
            lever_arm_m: params.lever_arm_m,
            flank: (0..basis.samples).map(flank).collect(),
            prices: (0..basis.len()).map(price).collect(),
            envelope,
            seeds: SeedLibrary::rich(&basis, params.half_side_m),
            friction: friction_of(library)?,
            basis,
        }))
    }
}
