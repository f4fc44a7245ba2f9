use std::collections::VecDeque;
use std::f64::consts::TAU;
use std::time::Duration;

use rand_pcg::rand_core::Rng as _;

use super::plant::{Oil, PlantFaults};
use super::{FaultKind, FaultSpec, FaultyComponent, picture, trace};
use crate::{Plant, SimRig};
use upm_core::geometry::Vec2;
use upm_core::random::{Rng, Streams};
use upm_core::rig::{Rig, RigError};
use upm_core::signal::{AccelTrace, Drive, Frame, MOTORS, MeasuredPositions};
use upm_core::time::PlateTime;
use upm_core::units::{GRAVITY_MPS2, m_from_mm};

/// Consecutive lost frames after which the camera counts as disconnected.
const MOST_LOST: usize = 600;
/// Factors on the friction of a glued part, of one on ice and of an oily spot.
const GLUED: f64 = 1000.0;
const ICE: f64 = 0.001;
const OIL: f64 = 0.1;
/// Relative amplitude of flicker.
const FLICKER: f64 = 0.3;

/// Pixels of a frame, or positions in their place.
type Picture = (Vec<u8>, Option<MeasuredPositions>);

/// A rig with faults. All their randomness comes from a separate stream.
///
/// Faults take effect where time passes: one of the plant with the first frame or pulse at or after its onset, one of
/// the camera with the first exposure, one of an accelerometer with the first sample.
pub struct Faulty<'a> {
    rig: &'a mut SimRig,
    faults: Vec<FaultSpec>,
    /// True for a one-time fault that has happened.
    done: Vec<bool>,
    streams: Streams,
    noise: Rng,
    /// Wait function for a hang, by wall time.
    wait: &'a dyn Fn(Duration),
    plant: PlantFaults,
    started_at: PlateTime,
    /// Pictures before delay, newest last, for the fault `late`.
    taken: VecDeque<Picture>,
    longest_lag: usize,
    /// The last delivered picture, kept for the fault `freeze`.
    shown: Option<Picture>,
}

impl<'a> Faulty<'a> {
    /// `rig` with `faults`; `wait` waits for the given wall time.
    pub fn new(rig: &'a mut SimRig, faults: &[FaultSpec], streams: Streams, wait: &'a dyn Fn(Duration)) -> Self {
        let lag = |fault: &FaultSpec| {
            let is_late = fault.component == FaultyComponent::Camera && fault.kind == FaultKind::Late;
            if is_late { fault.values[0] as usize } else { 0 }
        };
        Self {
            rig,
            done: vec![false; faults.len()],
            longest_lag: faults.iter().map(lag).max().unwrap_or(0),
            faults: faults.to_vec(),
            streams,
            noise: streams.stream("faults"),
            wait,
            plant: PlantFaults::default(),
            started_at: PlateTime::ZERO,
            taken: VecDeque::new(),
            shown: None,
        }
    }

    /// The faults present at `now`.
    fn held(&self, now: PlateTime) -> impl Iterator<Item = &FaultSpec> {
        self.faults.iter().filter(move |fault| fault.holds(now))
    }

    /// The fault of `kind` at `component` present at `now`.
    fn find(&self, now: PlateTime, component: FaultyComponent, kind: FaultKind) -> Option<FaultSpec> {
        self.held(now).find(|fault| fault.component == component && fault.kind == kind).copied()
    }

    /// Uniform from 0 to 1.
    fn draw(&mut self) -> f64 {
        (self.noise.next_u64() >> 11) as f64 * 2f64.powi(-53)
    }

    /// Applies the faults of the plant that are due.
    fn settle_plant(&mut self) {
        let now = self.rig.now();
        for i in 0..self.faults.len() {
            if now >= self.faults[i].from && !self.done[i] {
                self.done[i] = change(&mut self.rig.plant, &self.faults[i]);
            }
        }
        let mut plant = plant_faults(self.held(now), self.rig.plant.parts().len());
        for i in 0..self.faults.len() {
            let fault = self.faults[i];
            if fault.kind == FaultKind::Chatter && fault.holds(now) && self.draw() < fault.values[0] {
                coils_of(fault.component).for_each(|coil| plant.coils.gain[coil] = 0.0);
            }
        }
        if plant != self.plant {
            self.rig.set_faults(&plant);
            self.plant = plant;
        }
    }

    /// Waits for the length of a hang that is due, once.
    fn hang(&mut self) {
        let now = self.rig.now();
        for i in 0..self.faults.len() {
            if self.faults[i].kind == FaultKind::Hang && self.faults[i].holds(now) && !self.done[i] {
                self.done[i] = true;
                (self.wait)(Duration::try_from_secs_f64(self.faults[i].values[0]).unwrap_or_default());
            }
        }
    }

    fn refuse_broken(&self) -> Result<(), RigError> {
        match self.find(self.rig.now(), FaultyComponent::Device, FaultKind::Error) {
            Some(_) => Err(RigError::Device("the controller does not answer".into())),
            None => Ok(()),
        }
    }

    fn loses_frame(&mut self, at: PlateTime) -> bool {
        let lost = self.find(at, FaultyComponent::Camera, FaultKind::Drop).map_or(0.0, |fault| fault.values[0]);
        lost > 0.0 && self.draw() < lost
    }

    /// Applies all picture faults, from the scene to the delivered picture.
    fn apply_faults(&mut self, frame: &mut Frame) {
        let at = frame.exposed_at;
        let held: Vec<FaultSpec> = self.held(at).copied().collect();
        for fault in &held {
            match fault.kind {
                FaultKind::Ghost => {
                    if let Some(disc) = self.rig.seen_disc(place_m(fault)) {
                        picture::paint(frame, disc);
                    }
                }
                FaultKind::Hand => picture::cover(frame, fault.values[0]),
                _ => {}
            }
        }
        for fault in &held {
            self.alter_picture(frame, fault, at);
        }
        self.deliver(frame, &held);
        for fault in held.iter().filter(|fault| fault.kind == FaultKind::Skew) {
            let skewed_s = frame.exposed_at.secs() + fault.values[0];
            frame.exposed_at = PlateTime::from_secs(skewed_s.max(0.0));
        }
    }

    fn alter_picture(&mut self, frame: &mut Frame, fault: &FaultSpec, at: PlateTime) {
        let value = fault.values[0];
        match (fault.component, fault.kind) {
            (_, FaultKind::Shift) => picture::knock(frame, Vec2::new(value, fault.values[1]), 0.0),
            (_, FaultKind::Rotate) => picture::knock(frame, Vec2::zeros(), value.to_radians()),
            (_, FaultKind::Mirror) => picture::mirror(frame),
            (FaultyComponent::Light, FaultKind::Gain) | (_, FaultKind::Exposure) => {
                picture::light(frame, value.max(0.0))
            }
            (_, FaultKind::Flicker) => {
                picture::light(frame, 1.0 + FLICKER * libm::sin(TAU * value * (at - fault.from)));
            }
            (_, FaultKind::Dark) => picture::scatter(frame, &mut self.noise, 0x03),
            (FaultyComponent::Camera, FaultKind::Garbage) => picture::scatter(frame, &mut self.noise, 0xff),
            _ => {}
        }
    }

    /// Applies delayed and frozen pictures.
    fn deliver(&mut self, frame: &mut Frame, held: &[FaultSpec]) {
        let with = |kind| held.iter().find(|fault| fault.component == FaultyComponent::Camera && fault.kind == kind);
        if self.longest_lag > 0 {
            self.taken.push_back((frame.pixels.clone(), frame.positions.clone()));
            if self.taken.len() > self.longest_lag + 1 {
                self.taken.pop_front();
            }
            let lag = with(FaultKind::Late).map_or(0, |fault| fault.values[0] as usize);
            let at = self.taken.len().saturating_sub(lag + 1);
            if let Some(picture) = self.taken.get(at).filter(|_| lag > 0) {
                show(frame, picture);
            }
        }
        if !self.faults.iter().any(|fault| fault.kind == FaultKind::Freeze) {
            return;
        }
        match &self.shown {
            Some(picture) if with(FaultKind::Freeze).is_some() => show(frame, picture),
            _ => self.shown = Some((frame.pixels.clone(), frame.positions.clone())),
        }
    }
}

impl Rig for Faulty<'_> {
    fn now(&self) -> PlateTime {
        self.rig.now()
    }

    fn play(&mut self, drive: &Drive) -> Result<(), RigError> {
        self.settle_plant();
        self.refuse_broken()?;
        if self.find(self.rig.now(), FaultyComponent::Device, FaultKind::Busy).is_some() {
            return Err(RigError::Busy(self.rig.settled_at()));
        }
        self.started_at = self.rig.now();
        self.rig.play(drive)
    }

    fn takes_over(&self) -> bool {
        self.rig.takes_over()
    }

    fn take_over(&mut self, drive: &Drive) -> Result<PlateTime, RigError> {
        self.settle_plant();
        self.refuse_broken()?;
        self.started_at = self.rig.now();
        self.rig.take_over(drive)
    }

    fn settled_at(&self) -> PlateTime {
        self.rig.settled_at()
    }

    fn capture(&mut self, frame: &mut Frame) -> Result<(), RigError> {
        self.hang();
        for _ in 0..MOST_LOST {
            self.settle_plant();
            self.refuse_broken()?;
            self.rig.capture(frame)?;
            if !self.loses_frame(frame.exposed_at) {
                self.apply_faults(frame);
                return Ok(());
            }
        }
        Err(RigError::Device(format!("the camera sends nothing: {MOST_LOST} frames are lost in a row")))
    }

    fn trace(&self) -> AccelTrace {
        let mut read = self.rig.trace();
        let mut noise = self.streams.numbered("faults of a trace", self.started_at.nanos());
        for fault in &self.faults {
            if let FaultyComponent::Accelerometer(channel) = fault.component {
                trace::apply_fault(&mut read, fault, channel, self.started_at, &mut noise);
            }
        }
        read
    }

    fn stop(&mut self) {
        if self.find(self.rig.now(), FaultyComponent::Device, FaultKind::Deaf).is_none() {
            self.rig.stop();
        }
    }

    fn pass(&mut self, until: PlateTime) -> Result<(), RigError> {
        self.settle_plant();
        self.rig.pass(until)
    }
}

fn show(frame: &mut Frame, (pixels, positions): &Picture) {
    frame.pixels.clone_from(pixels);
    frame.positions.clone_from(positions);
}

/// The first two values as a position or a displacement, m.
fn place_m(fault: &FaultSpec) -> Vec2 {
    Vec2::new(m_from_mm(fault.values[0]), m_from_mm(fault.values[1]))
}

/// Makes the sudden change of `fault` to the plant; false for faults of another kind.
fn change(plant: &mut Plant, fault: &FaultSpec) -> bool {
    match (fault.component, fault.kind) {
        (FaultyComponent::Part(part), FaultKind::Moved) => plant.parts.shift(part, place_m(fault)),
        (FaultyComponent::Parts, FaultKind::Swapped) => {
            fault.pair().into_iter().for_each(|pair| plant.parts.exchange(pair))
        }
        (_, FaultKind::Bumped) => plant.plate.bump(place_m(fault)),
        _ => return false,
    }
    plant.still = false;
    true
}

fn coils_of(component: FaultyComponent) -> std::ops::Range<usize> {
    match component {
        FaultyComponent::Coil(coil) => coil..coil + 1,
        FaultyComponent::Coils => 0..MOTORS,
        _ => 0..0,
    }
}

/// All present faults of a plant with `parts` parts.
fn plant_faults<'f>(held: impl Iterator<Item = &'f FaultSpec>, parts: usize) -> PlantFaults {
    let mut plant = PlantFaults { friction: vec![1.0; parts], ..PlantFaults::default() };
    for fault in held {
        let value = fault.values[0];
        match fault.component {
            FaultyComponent::Coil(_) | FaultyComponent::Coils => alter_coils(&mut plant, fault),
            FaultyComponent::Part(part) => {
                let factor = match fault.kind {
                    FaultKind::Glued => GLUED,
                    FaultKind::Ice => ICE,
                    FaultKind::Friction => value,
                    _ => 1.0,
                };
                plant.friction.get_mut(part).into_iter().for_each(|friction| *friction *= factor);
                plant.removed.extend((fault.kind == FaultKind::Removed).then_some(part));
            }
            FaultyComponent::Parts if fault.kind == FaultKind::Friction => {
                plant.friction.iter_mut().for_each(|friction| *friction *= value);
            }
            FaultyComponent::Camera if fault.kind == FaultKind::Exposure => plant.exposure = value,
            FaultyComponent::Plate => match fault.kind {
                FaultKind::Tilt => plant.pull_mps2.x += GRAVITY_MPS2 * libm::sin(value.to_radians()),
                FaultKind::Resonance => plant.resonance = value,
                FaultKind::Oil => {
                    let radius_m = m_from_mm(fault.values[2]);
                    plant.oil = Some(Oil { center_m: place_m(fault), radius_m, friction: OIL });
                }
                _ => {}
            },
            _ => {}
        }
    }
    if plant.friction.iter().all(|&friction| friction == 1.0) {
        plant.friction.clear();
    }
    plant
}

fn alter_coils(plant: &mut PlantFaults, fault: &FaultSpec) {
    let coils = &mut plant.coils;
    if let Some([a, b]) = fault.pair().filter(|pair| pair.iter().all(|&coil| coil < MOTORS)) {
        coils.source.swap(a, b);
    }
    for coil in coils_of(fault.component) {
        match fault.kind {
            FaultKind::Dead => coils.gain[coil] = 0.0,
            FaultKind::Gain => coils.gain[coil] *= fault.values[0],
            FaultKind::Reversed => coils.gain[coil] *= -1.0,
            FaultKind::Stuck => coils.stuck[coil] = true,
            FaultKind::LowPass => coils.low_pass_hz[coil] = fault.values[0],
            _ => {}
        }
    }
}
