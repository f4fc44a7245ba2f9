//! Charts as plain data: what is drawn, not how. With the feature `svg` the function of that name draws one as a picture.

#[cfg(feature = "svg")]
mod svg;

#[cfg(feature = "svg")]
pub use svg::{svg, svg_page};

/// One picture: layers over a pair of axes.
#[derive(Clone, Debug, PartialEq)]
pub struct Chart {
    /// Stem of the file it goes into: `cor-steering`.
    pub name: String,
    /// One line above it.
    pub title: String,
    /// Horizontal axis.
    pub x: Axis,
    /// Vertical axis.
    pub y: Axis,
    /// True for a map: one unit is as long along x as along y.
    pub map: bool,
    /// Drawn one over the other, in order.
    pub layers: Vec<Layer>,
}

impl Chart {
    /// A plot of one quantity over another, each with its unit; the axes show what the layers need.
    pub fn plot(name: impl Into<String>, title: impl Into<String>, [x, y]: [&str; 2], layers: Vec<Layer>) -> Self {
        Self { name: name.into(), title: title.into(), x: Axis::new(x), y: Axis::new(y), map: false, layers }
    }

    /// A map of a plate from above, in millimetres: up to `reach` from its middle, or what the layers need.
    pub fn plate_map(
        name: impl Into<String>,
        title: impl Into<String>,
        reach: Option<f64>,
        layers: Vec<Layer>,
    ) -> Self {
        let axis = |label: &str| Axis { label: label.to_owned(), range: reach.map(|reach| [-reach, reach]) };
        Self { name: name.into(), title: title.into(), x: axis("x (mm)"), y: axis("y (mm)"), map: true, layers }
    }
}

/// An axis and the range it shows.
#[derive(Clone, Debug, PartialEq)]
pub struct Axis {
    /// Quantity with its unit: `speed (mm/s)`.
    pub label: String,
    /// From and to; `None` for what the layers need.
    pub range: Option<[f64; 2]>,
}

impl Axis {
    /// An axis that shows all there is.
    pub fn new(label: &str) -> Self {
        Self { label: label.to_owned(), range: None }
    }
}

/// Points and how they are drawn, in the axes' units.
#[derive(Clone, Debug, PartialEq)]
pub struct Layer {
    /// Name in the legend; empty for none.
    pub label: String,
    /// The points.
    pub points: Vec<[f64; 2]>,
    /// How they are drawn.
    pub mark: Mark,
    /// In which colour.
    pub color: Color,
}

/// How a layer's points are drawn.
#[derive(Clone, Debug, PartialEq)]
pub enum Mark {
    /// A line from each to the next.
    Line,
    /// A broken line from each to the next.
    Dashes,
    /// A dot at each.
    Dots,
    /// A cross at each.
    Crosses,
    /// A circle's outline about each, radius in the axes' unit; round on a map.
    Circles {
        /// Radius.
        radius: f64,
    },
    /// An arrow from each, as long as given for each.
    Arrows {
        /// From the point to the arrow's head.
        vectors: Vec<[f64; 2]>,
    },
    /// A filled square about each, shaded by a value from 0 (light) to 1 (full colour).
    Cells {
        /// Side, in the axes' unit.
        side: f64,
        /// One for each point.
        values: Vec<f64>,
    },
    /// Words beside each, off the line from each point to the next.
    Labels {
        /// One for each point.
        texts: Vec<String>,
    },
}

/// Colours that are told apart by people with any colour sight (Okabe and Ito, 2008).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Color {
    /// For frames, references and everything that is only there to compare with.
    Gray,
    /// First choice.
    Blue,
    /// Second.
    Orange,
    /// Third.
    Green,
    /// Fourth.
    Purple,
    /// For what is wrong or missed.
    Red,
}

impl Color {
    /// Red, green, blue.
    pub fn rgb(self) -> [u8; 3] {
        match self {
            Self::Gray => [120, 120, 120],
            Self::Blue => [0, 114, 178],
            Self::Orange => [230, 159, 0],
            Self::Green => [0, 158, 115],
            Self::Purple => [204, 121, 167],
            Self::Red => [213, 94, 0],
        }
    }

    /// One for each of several things, in order; they repeat after four.
    pub fn nth(i: usize) -> Self {
        [Self::Blue, Self::Orange, Self::Green, Self::Purple][i % 4]
    }
}

impl Layer {
    /// A layer of `points`.
    pub fn new(label: &str, mark: Mark, color: Color, points: impl IntoIterator<Item = [f64; 2]>) -> Self {
        Self { label: label.to_owned(), points: points.into_iter().collect(), mark, color }
    }

    /// The outline of a square plate of this half side.
    pub fn plate(half_side: f64) -> Self {
        let h = half_side;
        Self::new("plate", Mark::Line, Color::Gray, [[-h, -h], [h, -h], [h, h], [-h, h], [-h, -h]])
    }
}

/// Parts moving on a plate over plate time, to be played back.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Playback {
    /// Half the plate's side, m.
    pub half_side_m: f64,
    /// Instants, s.
    pub t_s: Vec<f64>,
    /// Parts.
    pub tracks: Vec<PlaybackTrack>,
}

/// The path of one part.
#[derive(Clone, Debug, PartialEq)]
pub struct PlaybackTrack {
    /// Name.
    pub label: String,
    /// Radius, m.
    pub radius_m: f64,
    /// Position at each instant, m, table frame.
    pub positions_m: Vec<[f64; 2]>,
}
