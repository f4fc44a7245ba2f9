//! A made-up run for the tests of recorders: parts that walk a cross, a picture of each cycle, drives, traces and
//! fits that agree with each other. Nothing is simulated.

use nalgebra::{Matrix2, Vector3};
use rand_pcg::rand_core::Rng as _;

use crate::control::{CycleFacts, FrameFacts, LocalisedFacts, PulseFacts, Sink};
use crate::estimation::{PlateFit, TwistFit, WaveFit, axis_phasors, nearest_pump};
use crate::geometry::{Homography, Lens, Pose, Twist, Vec2};
use crate::goal::Wanted;
use crate::library::{AxisShape, DisplacementModel, Entry, Library};
use crate::planner::{FieldPulse, Plan, PlanStatus, PlannedPulse, Rotation};
use crate::random::{Rng, Streams};
use crate::rig::RigModel;
use crate::signal::{AccelTrace, Drive, Envelope, Frame, Harmonic, TwistHarmonic, TwistWave};
use crate::sim::{PartTruth, Truth, TruthProbe};
use crate::time::PlateTime;
use crate::vision::{Detection, HoughArray, Plane, Stages, Table, Track};

const BASE_RADPS: f64 = std::f64::consts::TAU * 60.0;
const SIDE_M: f64 = 0.2032;
pub(super) const RADIUS_M: f64 = 0.009_525;
const PX_PER_M: f64 = 4300.0;
const TURN_RAD: f64 = 0.05;

/// 81 rotations about points on and around the plate, and four translations.
pub(super) fn library() -> Library {
    let grid = (0..81).map(|i| Vec2::new(f64::from(i % 9 - 4), f64::from(i / 9 - 4)) * 0.035);
    let rotations = grid.map(|center_m| Twist::about(center_m, 3.0));
    let translations = [(0.3, 0.0), (0.0, 0.3), (-0.3, 0.0), (0.0, -0.3)].map(|(x, y)| Twist::new(x, y, 0.0));
    let entries = rotations.chain(translations).map(|pump| Entry { amplitudes: [-128, -128, 128, 128], pump });
    Library {
        rig: "made up".into(),
        fingerprint: "0".into(),
        plate_side_m: SIDE_M,
        base_radps: BASE_RADPS,
        attack_s: 0.01,
        rest_s: 0.04,
        accelerometer_gain: [1.0; 4],
        shapes: [AxisShape::FREE_MASS; 3],
        entries: entries.collect(),
        displacement: DisplacementModel::default(),
        fields: None,
    }
}

pub(super) fn model() -> RigModel {
    RigModel {
        name: "made up".into(),
        plate_side_m: SIDE_M,
        lever_arm_m: 0.05,
        plate_mass_kg: 0.5,
        plate_inertia_kgm2: 0.003,
        newtons_per_count: 0.01,
        count_limit: 2048.0,
        base_radps: BASE_RADPS,
        attack_s: 0.01,
        rest_s: 0.04,
        max_sustain_s: 0.5,
        fields: None,
        accelerometer_in_plate_m: Vec2::new(0.09, 0.09),
        frame_size_px: [1280, 1024],
        frame_hz: 60.0,
        exposure_s: 4e-3,
        lens: Lens::ideal(1500.0, Vec2::new(639.5, 511.5)),
        dark_parts: true,
    }
}

pub(super) struct SyntheticRun {
    /// Where the parts truly are.
    pub(super) parts_m: Vec<Vec2>,
    pub(super) truth: TruthProbe,
    /// Added to every true position to make the measured one.
    pub(super) sensing_offset_m: Vec2,
    /// Every wall time told.
    pub(super) wall_us: f64,
    /// True for synthesised fields in the rotations' place.
    pub(super) plans_fields: bool,
    pub(super) pulses_played: u64,
    pub(super) frames_taken: u64,
    now: PlateTime,
    cycle: u64,
    library: Library,
    frame: Frame,
    noise: Rng,
}

impl SyntheticRun {
    pub(super) fn new(parts: usize) -> Self {
        let angle = |i: usize| std::f64::consts::TAU * i as f64 / parts as f64;
        Self {
            parts_m: (0..parts).map(|i| Vec2::new(angle(i).cos(), angle(i).sin()) * 0.05).collect(),
            truth: TruthProbe::default(),
            sensing_offset_m: Vec2::new(2e-5, -1e-5),
            wall_us: 0.0,
            plans_fields: false,
            pulses_played: 0,
            frames_taken: 0,
            now: PlateTime::from_secs(0.1),
            cycle: 0,
            library: library(),
            frame: Frame::new(1280, 1024),
            noise: Streams::new(7).stream("picture"),
        }
    }

    pub(super) fn localise(&mut self, sink: &mut impl Sink) {
        self.draw();
        self.frame.exposed_at = self.now;
        let detections: Vec<Detection> = self.tracks().into_iter().map(|track| track.seen).collect();
        let (table, stages) = (table(), stages(&self.frame));
        sink.localised(&LocalisedFacts {
            frame: &self.frame,
            table: &table,
            detections: &detections,
            stages: &stages,
            localise_us: self.wall_us,
        });
    }

    /// Looks, plays two pulses or three with frames between, looks again.
    pub(super) fn cycle(&mut self, sink: &mut impl Sink) {
        self.draw();
        self.look(sink, false, true);
        let (observed_at, observed_m) = (self.now, self.measured());
        let (wanted, plan) = self.plan();
        for (pulse, predicted_m) in plan.pulses.iter().zip(&plan.predicted_m) {
            self.pulse(sink, pulse, predicted_m);
        }
        self.look(sink, false, false);
        sink.cycle(&CycleFacts {
            index: self.cycle,
            observed_at,
            observed_m: &observed_m,
            wanted: &wanted,
            plan: &plan,
            ended_at: self.now,
            result_m: &self.measured(),
            plan_us: self.wall_us,
            cycle_us: self.wall_us * 20.0,
        });
        self.cycle += 1;
    }

    /// The pulses of a cycle whose end is never told.
    pub(super) fn pulses_without_an_end(&mut self, sink: &mut impl Sink) {
        let (_, plan) = self.plan();
        self.pulse(sink, &plan.pulses[0], &plan.predicted_m[0]);
    }

    fn measured(&self) -> Vec<Vec2> {
        self.parts_m.iter().map(|p| p + self.sensing_offset_m).collect()
    }

    fn tracks(&self) -> Vec<Track> {
        let seen = |position_m: Vec2| Detection {
            kind: 0,
            center_px: image_from_table(position_m),
            radius_px: RADIUS_M * PX_PER_M,
            position_m,
            score: 0.97,
            covariance_px2: Matrix2::from_diagonal_element(4e-4),
        };
        self.measured().into_iter().map(|position_m| Track { seen: seen(position_m), frames_unseen: 0 }).collect()
    }

    /// The next frame, a sixtieth of a second later.
    pub(super) fn look(&mut self, sink: &mut impl Sink, sounding: bool, starts_cycle: bool) {
        self.now = self.now + 1.0 / 60.0;
        self.frame.exposed_at = self.now;
        self.frame.index += 1;
        self.frames_taken += 1;
        let truth = |&position_m: &Vec2| PartTruth {
            part_in_table: Pose { position_m, heading_rad: 0.0 },
            velocity_mps: Vec2::zeros(),
            on_plate: true,
        };
        let parts = self.parts_m.iter().map(truth).collect();
        self.truth.set(Truth { at: self.now, parts, plate_in_table: Pose::IDENTITY, collisions: 0 });
        let tracks = self.tracks();
        let track_us = self.wall_us;
        sink.frame(&FrameFacts { frame: &self.frame, tracks: &tracks, sounding, starts_cycle, track_us });
    }

    fn plan(&self) -> (Wanted, Plan) {
        let observed_m = self.measured();
        let phase = self.cycle as f64 * 0.04;
        let path = |i: usize| phase + i as f64 * 1.3;
        let goal = |i: usize| Vec2::new((path(i) * 1.1).sin(), (path(i) * 0.7).cos()) * 0.075;
        let targets_m: Vec<Vec2> = (0..observed_m.len()).map(goal).collect();
        let step = |(from, to): (&Vec2, &Vec2)| from + (to - from).cap_magnitude(0.006);
        let subgoals_m: Vec<Vec2> = observed_m.iter().zip(&targets_m).map(step).collect();
        let count = 2 + (self.cycle % 2) as usize;
        let pulses: Vec<PlannedPulse> = (0..count)
            .map(|j| {
                let entry = (self.cycle as usize * 11 + j * 37) % self.library.entries.len();
                let distance_m = 0.004 * (1.0 + j as f64) * if j == 1 { -0.6 } else { 1.0 };
                let sustain_s = 0.04 + 0.02 * j as f64;
                match self.plans_fields {
                    true => PlannedPulse::Field(FieldPulse { wave: wave(1.0), sustain_s }),
                    false => PlannedPulse::Rotation(Rotation { entry, distance_m, sustain_s }),
                }
            })
            .collect();
        let part_way = |j: usize| {
            let share = (j + 1) as f64 / count as f64;
            observed_m.iter().zip(&subgoals_m).map(|(a, b)| a + (b - a) * share).collect()
        };
        let predicted_m = (0..count).map(part_way).collect();
        let wanted = Wanted {
            cross_track_m: subgoals_m.iter().map(|p| p.x * 0.002).collect(),
            subgoals_m,
            targets_m,
            phase: format!("lap 1 of 2: branch {}", self.cycle / 20),
            progress: 0.1,
            ..Wanted::default()
        };
        (wanted, Plan { status: PlanStatus::Solved, pulses, candidates: (0..48).collect(), predicted_m })
    }

    fn pulse(&mut self, sink: &mut impl Sink, planned: &PlannedPulse, predicted_m: &[Vec2]) {
        let pump = match planned {
            PlannedPulse::Rotation(planned) => self.library.entries[planned.entry].pump * planned.distance_m.signum(),
            PlannedPulse::Field(planned) => planned.wave.harmonics[0].cos,
        };
        let wave = [Harmonic { cos: 420.0, sin: 0.0 }, Harmonic { cos: 0.0, sin: -431.25 }];
        let scaled = |scale: f64| wave.iter().map(|h| Harmonic { cos: h.cos * scale, sin: h.sin * scale }).collect();
        let drive = Drive {
            base_radps: BASE_RADPS,
            motors: [scaled(-0.5), scaled(-0.25), scaled(0.75), scaled(1.0)],
            envelope: Envelope { attack_s: 0.01, sustain_s: planned.sustain_s(), rest_s: 0.04 },
        };
        let (trace, fit) = self.trace(pump, &drive);
        let fit = if self.plans_fields { PlateFit::Wave(wave_fit()) } else { PlateFit::Twist(fit) };
        let started_at = self.now;
        let start_m = self.parts_m.clone();
        let frames = (drive.envelope.total_s() * 60.0).ceil() as usize;
        for k in 1..=frames {
            let share = k as f64 / frames as f64;
            let go = |(from, to): (&Vec2, &Vec2)| from + (to * 0.99 - from) * share;
            self.parts_m = start_m.iter().zip(predicted_m).map(go).collect();
            self.look(sink, k + 2 < frames, false);
        }
        self.pulses_played += 1;
        sink.pulse(&PulseFacts {
            cycle: self.cycle,
            started_at,
            planned,
            drive: &drive,
            trace: &trace,
            fit: &Ok(fit),
            carried: None,
        });
    }

    fn trace(&mut self, pump: Twist, drive: &Drive) -> (AccelTrace, TwistFit) {
        let corner = Vec2::new(0.09, 0.09);
        let (v1, v2) = (pump.velocity_at(corner), pump.velocity_at(-corner));
        let accel = [v1.x, v1.y, v2.x, v2.y].map(|v| [0.0, -BASE_RADPS * v, 0.0, BASE_RADPS * v]);
        let mps2_per_count = 0.4;
        let samples = (drive.envelope.sounding_s() * 5000.0) as usize;
        let counts = accel.map(|[_, s1, _, s2]| {
            let sample = |i: usize| {
                let t = i as f64 / 5000.0;
                let height = drive.envelope.at(t);
                let clean = height * (s1 * (BASE_RADPS * t).sin() + s2 * (2.0 * BASE_RADPS * t).sin());
                let noise = 3.0 * (self.noise.next_u32() as f64 / f64::from(u32::MAX) - 0.5);
                ((clean + noise) / mps2_per_count).round() as i16
            };
            (0..samples).map(sample).collect()
        });
        let trace = AccelTrace { sample_hz: 5000.0, first_sample_s: 0.0, mps2_per_count, count_limit: 1023, counts };
        let wave = TwistWave::pump(pump, BASE_RADPS);
        let axes = axis_phasors(&wave);
        let (_, quality) = nearest_pump(&axes, corner.norm());
        (trace, TwistFit { accel_mps2: accel, residual_rms_mps2: 0.9, wave, axes, pump, quality })
    }

    /// When the last frame was taken.
    #[cfg(feature = "rerun")]
    pub(super) fn now(&self) -> PlateTime {
        self.now
    }

    /// Noise alone, which no picture file makes small.
    #[cfg(feature = "rerun")]
    pub(super) fn snow(&mut self) {
        let noise = &mut self.noise;
        self.frame.pixels.iter_mut().for_each(|pixel| *pixel = noise.next_u32() as u8);
    }

    /// Black ground, white plate, black discs, some noise.
    pub(super) fn draw(&mut self) {
        let discs: Vec<Vec2> = self.parts_m.iter().map(|&p| image_from_table(p)).collect();
        for y in 0..1024 {
            for x in 0..1280 {
                let px = Vec2::new(f64::from(x), f64::from(y));
                let plate_m = table_from_image(px);
                let on_part = discs.iter().any(|disc| (px - disc).norm() < RADIUS_M * PX_PER_M);
                let level = if plate_m.amax() > SIDE_M / 2.0 {
                    25
                } else if on_part {
                    40
                } else {
                    205
                };
                let noise = (self.noise.next_u32() & 7) as u8;
                self.frame.pixels[(y * 1280 + x) as usize] = level + noise;
            }
        }
    }
}

/// Three harmonics, scaled.
fn wave(scale: f64) -> TwistWave {
    let harmonic = |k: u32| TwistHarmonic {
        cos: Twist::new(0.25, -0.125, 1.5) * (scale / f64::from(k)),
        sin: Twist::new(0.0625, 0.125, -0.5) * scale,
    };
    TwistWave { base_radps: BASE_RADPS, harmonics: (1..=3).map(harmonic).collect() }
}

/// A tenth more than was asked for.
fn wave_fit() -> WaveFit {
    let accel_mps2 = std::array::from_fn(|channel| vec![[10.0, channel as f64]; 3]);
    WaveFit { accel_mps2, residual_rms_mps2: 0.9, wave: wave(1.1) }
}

fn image_from_table(p_m: Vec2) -> Vec2 {
    let turned = nalgebra::Rotation2::new(TURN_RAD) * p_m * PX_PER_M;
    Vec2::new(650.0 + turned.x, 505.0 - turned.y)
}

fn table_from_image(px: Vec2) -> Vec2 {
    nalgebra::Rotation2::new(-TURN_RAD) * Vec2::new(px.x - 650.0, 505.0 - px.y) / PX_PER_M
}

fn table() -> Table {
    let h = SIDE_M / 2.0;
    let corners_m = [(-h, h), (h, h), (h, -h), (-h, -h)].map(|(x, y)| Vec2::new(x, y));
    let corners_px = corners_m.map(image_from_table);
    let table_from_ideal = Homography::from_corners(corners_px, corners_m).unwrap();
    Table {
        corners_px,
        side_px: SIDE_M * PX_PER_M,
        rotation_rad: TURN_RAD,
        side_m: SIDE_M,
        lens: model().lens,
        table_from_ideal,
        ideal_from_table: table_from_ideal.inverse().unwrap(),
        camera_in_table_m: Vector3::new(0.0, 0.0, 0.4),
    }
}

/// Plain gradients, their votes, and how dark the neighbourhood of each pixel is.
fn stages(frame: &Frame) -> Stages {
    let (width, height) = (frame.width, frame.height);
    let at = |x: usize, y: usize| f32::from(frame.pixels[y * width + x]);
    let mut edges = Plane { width, height, values: vec![0.0; width * height] };
    let mut response = edges.clone();
    let (angles, distances) = (720, 820);
    let mut votes = vec![0.0; angles * distances];
    for y in 48..height - 48 {
        for x in 48..width - 48 {
            let (gx, gy) = (at(x + 1, y) - at(x - 1, y), at(x, y + 1) - at(x, y - 1));
            let strength = gx.hypot(gy);
            if strength > 60.0 {
                edges.values[y * width + x] = strength;
                let angle = gy.atan2(gx).rem_euclid(std::f32::consts::TAU);
                let distance = (x as f32 - 639.5) * angle.cos() + (y as f32 - 511.5) * angle.sin();
                let column = (angle / std::f32::consts::TAU * angles as f32) as usize % angles;
                if distance >= 0.0 {
                    for spread in 0..25 {
                        let row = (distance as usize + spread / 5).min(distances - 1);
                        votes[row * angles + (column + spread % 5) % angles] += 1.0;
                    }
                }
            }
            if x % 4 == 0 && y % 4 == 0 {
                let dark = (0..64).filter(|i| at(x + (i % 8) * 8 - 28, y + (i / 8) * 8 - 28) < 100.0).count();
                for i in 0..16 {
                    response.values[(y + i / 4) * width + x + i % 4] = dark as f32 / 64.0;
                }
            }
        }
    }
    let strongest = |turn: usize| {
        let cells = (0..angles * distances).filter(|i| (i % angles + 90) % angles / 180 == turn);
        cells.max_by(|&a, &b| f32::total_cmp(&votes[a], &votes[b])).map(|i| (i % angles, i / angles))
    };
    let peaks = (0..4).filter_map(strongest).collect();
    Stages { edges, hough: HoughArray { angles, distances, px_per_row: 1.0, votes, peaks }, disk_response: response }
}
