//! Charts as plain data: their content, and the pictures of them as SVG. Tables as text.

#![allow(clippy::disallowed_methods, reason = "a picture may differ in the last bit")]

mod decades;
mod labels;
mod palette;
mod svg;
mod text_table;

use labels::{LabelledDisc, place_labels};
pub use palette::{Ground, Palette};

pub use svg::svg;
pub use text_table::text_table;

/// A chart: layers over a pair of axes.
#[derive(Clone, Debug, PartialEq)]
pub struct Chart {
    /// Stem of its file name: `cor-steering`.
    pub name: String,
    /// Title, one line above the chart.
    pub title: String,
    /// Horizontal axis.
    pub x: Axis,
    /// Vertical axis.
    pub y: Axis,
    /// True for a map, whose units are equally long along x and y.
    pub map: bool,
    /// Layers, drawn one over the other in this order.
    pub layers: Vec<Layer>,
}

impl Chart {
    /// A plot of one quantity over another, each with its unit; the axes fit the layers.
    pub fn plot(name: impl Into<String>, title: impl Into<String>, [x, y]: [&str; 2]) -> Self {
        Self::over(name, title, [Axis::new(x), Axis::new(y)])
    }

    /// A plot over these axes.
    pub fn over(name: impl Into<String>, title: impl Into<String>, [x, y]: [Axis; 2]) -> Self {
        Self { name: name.into(), title: title.into(), x, y, map: false, layers: Vec::new() }
    }

    /// The chart with further layers over its own.
    pub fn with(mut self, layers: impl IntoIterator<Item = Layer>) -> Self {
        self.layers.extend(layers);
        self
    }

    /// The chart with a further line.
    pub fn line(self, label: &str, color: Color, points: impl IntoIterator<Item = [f64; 2]>) -> Self {
        self.with([Layer::new(label, Mark::Line, color, points)])
    }

    /// The chart with a further dashed line.
    pub fn dashes(self, label: &str, color: Color, points: impl IntoIterator<Item = [f64; 2]>) -> Self {
        self.with([Layer::new(label, Mark::Dashes, color, points)])
    }

    /// The chart with further dots.
    pub fn dots(self, label: &str, color: Color, points: impl IntoIterator<Item = [f64; 2]>) -> Self {
        self.with([Layer::new(label, Mark::Dots, color, points)])
    }

    /// A map of a plate from above, in millimetres: `reach` from its middle to each side, or the range of the layers.
    pub fn plate_map(
        name: impl Into<String>,
        title: impl Into<String>,
        reach: Option<f64>,
        layers: Vec<Layer>,
    ) -> Self {
        let axis = |label: &str| Axis { range: reach.map(|reach| [-reach, reach]), ..Axis::new(label) };
        Self { map: true, ..Self::over(name, title, [axis("x (mm)"), axis("y (mm)")]).with(layers) }
    }
}

/// An axis of a chart and its range.
#[derive(Clone, Debug, PartialEq)]
pub struct Axis {
    /// Quantity with its unit: `speed (mm/s)`.
    pub label: String,
    /// Range, from and to; `None` to fit the layers.
    pub range: Option<[f64; 2]>,
    /// True where equal distances are equal ratios and values that are not positive are left out.
    pub is_log: bool,
}

impl Axis {
    /// An axis that fits the layers.
    pub fn new(label: &str) -> Self {
        Self { label: label.to_owned(), range: None, is_log: false }
    }

    /// A logarithmic axis that fits the layers; values that are not positive are left out.
    pub fn log(label: &str) -> Self {
        Self { is_log: true, ..Self::new(label) }
    }
}

/// Points in the axes' units, with their mark and colour.
#[derive(Clone, Debug, PartialEq)]
pub struct Layer {
    /// Name in the legend; empty for none.
    pub label: String,
    /// The points, in the axes' units.
    pub points: Vec<[f64; 2]>,
    /// Mark drawn for the points.
    pub mark: Mark,
    /// Colour of the marks.
    pub color: Color,
}

/// Mark that a layer's points are drawn with.
#[derive(Clone, Debug, PartialEq)]
pub enum Mark {
    /// A solid line from each to the next.
    Line,
    /// A dashed line from each to the next.
    Dashes,
    /// A dot at each.
    Dots,
    /// A cross at each.
    Crosses,
    /// A circle's outline around each; round on a map.
    Circles {
        /// Radius, in the axes' unit.
        radius: f64,
    },
    /// An arrow from each, with a given vector.
    Arrows {
        /// Vector from each point to the arrow's head, in the axes' unit.
        vectors: Vec<[f64; 2]>,
    },
    /// A filled square around each, shaded by a value from 0 (light) to 1 (full colour).
    Cells {
        /// Side, in the axes' unit.
        side: f64,
        /// Value of each point, 0 to 1.
        values: Vec<f64>,
    },
    /// A name beside a disc around each, off all the discs and off the other names.
    Names {
        /// Name of each point.
        texts: Vec<String>,
        /// Radius of the disc around each, in the axes' unit.
        radii: Vec<f64>,
        /// Colour of each name.
        colors: Vec<Color>,
    },
    /// A text beside each, placed clear of the line from each point to the next.
    Labels {
        /// Text of each point.
        texts: Vec<String>,
    },
}

/// Colours that can be distinguished with any type of colour vision (Okabe and Ito, 2008).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Color {
    /// For frames, references and other context.
    Gray,
    /// First colour of a series.
    Blue,
    /// Second colour of a series.
    Orange,
    /// Third colour of a series.
    Green,
    /// Fourth colour of a series.
    Purple,
    /// For faults and missed targets.
    Red,
    /// Red, green and blue, 0 to 255: the colour of a part or a kind in a [`Palette`].
    Rgb([u8; 3]),
}

impl Color {
    /// Red, green and blue, 0 to 255.
    pub fn rgb(self) -> [u8; 3] {
        match self {
            Self::Gray => [120, 120, 120],
            Self::Blue => [0, 114, 178],
            Self::Orange => [230, 159, 0],
            Self::Green => [0, 158, 115],
            Self::Purple => [204, 121, 167],
            Self::Red => [213, 94, 0],
            Self::Rgb(rgb) => rgb,
        }
    }

    /// The colour of item `i` of a series; colours repeat after four.
    pub fn nth(i: usize) -> Self {
        [Self::Blue, Self::Orange, Self::Green, Self::Purple][i % 4]
    }
}

impl Layer {
    /// A layer of `points` drawn with `mark` in `color`.
    pub fn new(label: &str, mark: Mark, color: Color, points: impl IntoIterator<Item = [f64; 2]>) -> Self {
        Self { label: label.to_owned(), points: points.into_iter().collect(), mark, color }
    }

    /// The outline of a square plate of this half side.
    pub fn plate(half_side: f64) -> Self {
        let h = half_side;
        Self::new("plate", Mark::Line, Color::Gray, [[-h, -h], [h, -h], [h, h], [-h, h], [-h, -h]])
    }
}

/// Outline of a bin, a rectangle that parts are sorted into: its corners from `min` to `max`, the first one again at
/// the end.
pub fn bin_outline(min: [f64; 2], max: [f64; 2]) -> [[f64; 2]; 5] {
    [min, [max[0], min[1]], max, [min[0], max[1]], min]
}

/// The label of a bin for parts of `kinds` and for `parts` by name: `bin: dime, penny-3`.
pub fn bin_label(kinds: &[String], parts: &[String]) -> String {
    format!("bin: {}", [kinds, parts].concat().join(", "))
}
