//! Stand-ins for the commands of the feature `lab`, in a build without it.

use serde_json::Value;
use upm_chart::Chart;
use upm_core::signal::Frame;

use super::args::{Common, LabArgs, RenderArgs};
use super::features::{LAB, lacking};
use super::output::Failure;

pub(super) fn lab(_: &LabArgs, _: Common) -> Result<u8, Failure> {
    Err(lacking(LAB, "`upm lab`"))
}

pub(super) fn of_scene(_: &str, _: &RenderArgs) -> Result<(Frame, Value), Failure> {
    Err(lacking(LAB, "`upm render --scene`"))
}

pub(super) fn check_svg() -> Result<(), Failure> {
    Err(lacking(LAB, "`upm check --picture`"))
}

pub(super) fn svg(_: &Chart) -> Result<String, Failure> {
    Err(lacking(LAB, "`upm check --picture`"))
}
