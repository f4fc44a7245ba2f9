use upm_chart::Chart;

/// One experiment as a page of the viewer.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Experiment {
    /// Names the recording.
    pub title: String,
    /// The table of figures, Markdown.
    pub figures: String,
    /// Its charts.
    pub charts: Vec<Chart>,
    /// The motion of each part.
    pub motion: Option<Motion>,
}

/// Parts moving on a plate over plate time.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Motion {
    /// Half the plate's side, m.
    pub half_side_m: f64,
    /// Instants, s.
    pub t_s: Vec<f64>,
    /// Parts.
    pub tracks: Vec<Track>,
}

/// The path of one part.
#[derive(Clone, Debug, PartialEq)]
pub struct Track {
    /// Name.
    pub label: String,
    /// Radius, m.
    pub radius_m: f64,
    /// Position at each instant, m, table frame.
    pub positions_m: Vec<[f64; 2]>,
}
