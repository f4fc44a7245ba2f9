//! Synthetic camera pictures with ground truth, reproducible by seed: a plate with parts on it, for judging the
//! vision. The crate shares only the lens and homography types with the simulator's camera.
//!
//! ```text
//!   ground ─ things on it ─ plate ─ parts ─ covers      shapes on the plate's plane, later ones in front
//!      └──────── area of each pixel ────────┘
//!                       │  × light, falling off over the picture
//!                       │  * lens blur, a Gaussian
//!                       │  + noise
//!                       ▼
//!                  8-bit frame
//! ```
//!
//! ```
//! use upm_scene::{Difficulty, Scene};
//! let scene = Scene::generate(Difficulty::Rough, 7);
//! let (frame, corners_px, parts) = (scene.frame(), scene.corners_px(), scene.truth());
//! assert_eq!(frame.width, 1280);
//! assert_eq!(parts.len(), scene.parts.len());
//! assert!(corners_px[0].x < corners_px[1].x);
//! ```

#![allow(clippy::disallowed_methods, reason = "its pictures are drawn for tests")]

mod clutter;
mod exposure;
mod generate;
mod layers;
mod parts;
mod raster;
#[cfg(test)]
mod reference;
mod shape;
pub mod testing;
mod types;
mod view;

pub use generate::Difficulty;
pub use parts::kinds;
pub use shape::ClutterOutline;
pub use types::{ClutterShape, Glint, Scene, SceneDisc, ScenePartTruth, SurfaceTexture};
