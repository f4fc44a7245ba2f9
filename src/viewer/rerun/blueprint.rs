//! The layout of a recording: three pages, the whole run on the first.
//!
//! Rerun's Rust builder has no setters for the bounds of a 2D view or the time span of a plot. They are ordinary
//! properties of a view, so they are logged into the blueprint's store next to the builder's output.

use std::collections::BTreeMap;

use parking_lot::Mutex;

use re_sdk_types::blueprint::archetypes::{PlotLegend, TextLogColumns, TimeAxis, VisibleTimeRanges, VisualBounds2D};
use re_sdk_types::blueprint::components::{Corner2D, LinkAxis, PanelState, VisibleTimeRange};
use re_sdk_types::blueprint::datatypes::{TextLogColumn, TextLogColumnKind};
use re_sdk_types::datatypes;
use rerun::blueprint::{
    Blueprint, BlueprintActivation, BlueprintPanel, ContainerLike, Grid, Horizontal, SelectionPanel, Spatial2DView,
    Tabs, TextLogView, TimePanel, TimeSeriesView, Vertical,
};
use rerun::external::re_log_types::BlueprintActivationCommand;
use rerun::log::LogMsg;
use rerun::{AsComponents, RecordingStream, RecordingStreamBuilder, SerializedComponentBatch};

use super::plots::{BARS_WIDTH, SPEED};
use super::run_stream::{APPLICATION, PLATE_TIME};
use super::table::reach_mm;
use crate::types::RunContext;
use upm_planning::planner::PlanningMethod;

/// Seconds before and after the cursor that the plots of fast signals show. All other plots share one time axis.
const SIGNAL_SPAN_S: [f64; 2] = [-0.1, 0.3];

/// Views on two pages, each with its title and its entity.
const MOTORS: &str = "Motors, counts";
const TO_TARGET: (&str, &str) = ("Distance to target, mm", "errors/to_target_mm");
const FROM_PATH: (&str, &str) = ("Distance from the path, mm", "errors/cross_track_mm");

/// Views of the page of errors, each with its title and its entity.
const ERRORS: [(&str, &str); 10] = [
    TO_TARGET,
    ("Distance to subgoal after the cycle, mm", "errors/to_subgoal_mm"),
    ("Measured against predicted, mm", "errors/of_prediction_mm"),
    FROM_PATH,
    ("Measured against true, mm", "errors/sensing_mm"),
    ("Sum of |d| in a cycle, mm", TOTAL),
    ("Speed, mm/s", SPEED),
    ("Tracking a frame, µs", "timing/track_us"),
    ("Planning, µs", "timing/plan_us"),
    ("Whole cycle, µs", "timing/cycle_us"),
];
const TOTAL: &str = "plan/total_mm";

/// Sends the layout into `stream`.
pub(super) fn send(stream: &RecordingStream, context: &RunContext) -> Result<(), String> {
    let (key, mut made) = (key(context), MADE.lock());
    let layout = match made.get(&key) {
        Some(layout) => layout.clone(),
        None => {
            let mut layout = ViewLayout::default();
            let pages = pages(&mut layout, context);
            made.entry(key).or_insert(layout.encoded(pages)?).clone()
        }
    };
    stream.send_blueprint(layout.messages, layout.activation);
    Ok(())
}

/// Cache of layouts by their [`key`]. Making one takes three in-memory streams, which are never freed (rerun 0.36: each
/// holds itself), so a daemon would grow by them with every job.
static MADE: Mutex<BTreeMap<String, EncodedLayout>> = Mutex::new(BTreeMap::new());

/// A layout, encoded as messages.
#[derive(Clone)]
struct EncodedLayout {
    messages: Vec<LogMsg>,
    activation: BlueprintActivationCommand,
}

/// Everything that the layout depends on, as one text.
fn key(context: &RunContext) -> String {
    let RunContext { model, method, .. } = context;
    let paths = if context.paths.is_empty() { "no paths" } else { "paths" };
    format!("{method:?}, {paths}, frame {:?} px, plate {} m", model.frame_size_px, model.plate_side_m)
}

/// The pages in the order of their tabs.
fn pages(layout: &mut ViewLayout, context: &RunContext) -> Vec<ContainerLike> {
    vec![run(layout, context), signals(layout), errors(layout, context)]
}

fn run(layout: &mut ViewLayout, context: &RunContext) -> ContainerLike {
    let [width, height] = context.model.frame_size_px.map(|side| side as f64 / 2.0);
    let camera = layout.bounded("Camera as each cycle starts", "camera", [0.0, width], [0.0, height]);
    let table = layout.bounded("Table from above, mm", "table", reach_mm(context), reach_mm(context));
    let above = Horizontal::new([camera, table]).with_column_shares([1.25, 1.0]);
    let (title, errors) = if context.paths.is_empty() { TO_TARGET } else { FROM_PATH };
    let below = Horizontal::new([
        layout.plot(MOTORS, "motors", Some(SIGNAL_SPAN_S)),
        plan(layout, context.method),
        layout.plot(title, errors, None),
        layout.log(),
    ]);
    let below = below.with_column_shares([0.95, 0.8, 0.95, 1.3]);
    Vertical::new([above.into(), below.into()]).with_row_shares([2.0, 1.0]).with_name("Run").into()
}

/// The view of a plan: one bar per rotation, or one per harmonic of a field.
fn plan(layout: &mut ViewLayout, method: PlanningMethod) -> ContainerLike {
    let (name, origin) = match method {
        PlanningMethod::SynthesizedField | PlanningMethod::MovingField => ("Harmonics, mm/s", "plan/harmonics_mm_s"),
        PlanningMethod::CorSequence | PlanningMethod::PseudoInverse => ("Plan: d, mm", "plan/d_mm"),
    };
    layout.bounded(name, origin, [-0.05, BARS_WIDTH + 0.05], [-0.05, 1.15])
}

fn signals(layout: &mut ViewLayout) -> ContainerLike {
    let views = [
        layout.plot(MOTORS, "motors", Some(SIGNAL_SPAN_S)),
        layout.plot("Accelerometer 1, m/s²", "accelerometers/1", Some(SIGNAL_SPAN_S)),
        layout.plot("Accelerometer 2, m/s²", "accelerometers/2", Some(SIGNAL_SPAN_S)),
    ];
    Vertical::new(views).with_name("Signals").into()
}

fn errors(layout: &mut ViewLayout, context: &RunContext) -> ContainerLike {
    // fields have no d to sum up, and many tasks no path to keep to
    let shown = |path: &str| match path {
        TOTAL => !matches!(context.method, PlanningMethod::SynthesizedField | PlanningMethod::MovingField),
        SPEED => context.method == PlanningMethod::MovingField,
        path if path == FROM_PATH.1 => !context.paths.is_empty(),
        _ => true,
    };
    let shown = ERRORS.into_iter().filter(|(_, path)| shown(path));
    let views: Vec<ContainerLike> = shown.map(|(title, path)| layout.plot(title, path, None)).collect();
    Grid::new(views).with_grid_columns(3).with_name("Errors and timing").into()
}

/// Collects properties of views while they are built.
#[derive(Default)]
struct ViewLayout {
    properties: Vec<(String, Vec<SerializedComponentBatch>)>,
}

impl ViewLayout {
    /// A view of `entity` in just this range of x and y. Its origin is the root, so that a transform of `entity` holds.
    fn bounded(&mut self, name: &str, entity: &str, x: [f64; 2], y: [f64; 2]) -> ContainerLike {
        let range = datatypes::Range2D { x_range: datatypes::Range1D(x), y_range: datatypes::Range1D(y) };
        let view = Spatial2DView::new(name).with_origin("/").with_contents([format!("{entity}/**")]).into();
        self.set(&view, "VisualBounds2D", &VisualBounds2D::new(range));
        view
    }

    fn plot(&mut self, name: &str, origin: &str, span_s: Option<[f64; 2]>) -> ContainerLike {
        let view = TimeSeriesView::new(name).with_origin(origin).into();
        self.set(&view, "PlotLegend", &PlotLegend::new().with_corner(Corner2D::RightTop));
        if let Some(span_s) = span_s {
            let [start, end] =
                span_s.map(|s| datatypes::TimeRangeBoundary::CursorRelative(datatypes::TimeInt((s * 1e9) as i64)));
            let range = datatypes::TimeRange { start, end };
            let range = VisibleTimeRange(datatypes::VisibleTimeRange { timeline: PLATE_TIME.into(), range });
            self.set(&view, "VisibleTimeRanges", &VisibleTimeRanges::new([range]));
        } else {
            self.set(&view, "TimeAxis", &TimeAxis::new().with_link(LinkAxis::LinkToGlobal));
        }
        view
    }

    /// The log view with time, level and text; all lines come from one entity.
    fn log(&mut self) -> ContainerLike {
        let view = TextLogView::new("Log").with_origin("log").into();
        let shown = [TextLogColumnKind::LogLevel, TextLogColumnKind::Body];
        let columns = shown.map(|kind| TextLogColumn { visible: true.into(), kind });
        self.set(&view, "TextLogColumns", &TextLogColumns::new().with_text_log_columns(columns));
        view
    }

    fn set(&mut self, view: &ContainerLike, name: &str, property: &dyn AsComponents) {
        if let ContainerLike::View(view) = view {
            self.properties.push((format!("{}/{name}", view.blueprint_path()), property.as_serialized_batches()));
        }
    }

    fn encoded(self, pages: Vec<ContainerLike>) -> Result<EncodedLayout, String> {
        let blueprint = Blueprint::new(Tabs::new(pages))
            .with_auto_layout(false)
            .with_auto_views(false)
            .with_blueprint_panel(BlueprintPanel::from_state(PanelState::Collapsed))
            .with_selection_panel(SelectionPanel::from_state(PanelState::Collapsed))
            .with_time_panel(TimePanel::new().with_state(PanelState::Collapsed).with_timeline(PLATE_TIME));
        let faults = |e: rerun::RecordingStreamError| e.to_string();
        let builder = || RecordingStreamBuilder::new(APPLICATION).enabled(true);
        let (scratch, written) = builder().memory().map_err(faults)?;
        blueprint.send(&scratch, BlueprintActivation::default()).map_err(faults)?;
        let mut messages: Vec<LogMsg> =
            written.take().into_iter().filter(|message| message.store_id().is_blueprint()).collect();
        let Some(LogMsg::BlueprintActivationCommand(activation)) = messages.pop() else {
            return Err("the blueprint's last message does not activate it".to_owned());
        };
        let store = &activation.blueprint_id;
        let (properties, written) =
            RecordingStreamBuilder::from_store_id(store).enabled(true).memory().map_err(faults)?;
        properties.set_time_sequence("blueprint", 0);
        for (path, batches) in self.properties {
            properties.log_serialized_batches(path, false, batches).map_err(faults)?;
        }
        messages.extend(written.take().into_iter().filter(|message| matches!(message, LogMsg::ArrowMsg(..))));
        Ok(EncodedLayout { messages, activation })
    }
}
