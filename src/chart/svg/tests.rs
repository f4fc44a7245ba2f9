use proptest::prelude::*;

use super::svg;
use crate::{Axis, Chart, Color, Layer, Mark};

fn chart(map: bool, layers: Vec<Layer>) -> Chart {
    let (x, y) = (Axis::new("x (mm)"), Axis::new("y (mm)"));
    Chart { name: "test".into(), title: "A title".into(), x, y, map, layers }
}

/// A layer with each mark, at these points.
fn every_mark(points: &[[f64; 2]]) -> Vec<Layer> {
    let marks = [
        Mark::Line,
        Mark::Dashes,
        Mark::Dots,
        Mark::Crosses,
        Mark::Circles { radius: 12.0 },
        Mark::Arrows { vectors: points.to_vec() },
        Mark::Cells { side: 5.0, values: points.iter().map(|point| point[0]).collect() },
        Mark::Names {
            texts: points.iter().map(|point| format!("<<{}>>", point[0])).collect(),
            radii: points.iter().map(|point| point[1]).collect(),
            colors: points.iter().map(|_| Color::Rgb([1, 2, 3])).collect(),
        },
        Mark::Labels { texts: points.iter().map(|point| format!("<{}>", point[0])).collect() },
    ];
    let label = |mark: &Mark| format!("the {}", format!("{mark:?}").to_lowercase().split(' ').next().unwrap());
    marks
        .into_iter()
        .enumerate()
        .map(|(i, mark)| Layer::new(&label(&mark), mark, Color::nth(i), points.iter().copied()))
        .collect()
}

/// The tags of a document, each with its attributes; fails unless they nest and every text is escaped.
fn tags(document: &str) -> Vec<&str> {
    let mut open = Vec::new();
    let mut found = Vec::new();
    let mut rest = document;
    while let Some((text, after)) = rest.split_once('<') {
        assert!(!text.contains('>') && text.split('&').skip(1).all(|entity| entity.contains(';')), "{text}");
        let (tag, after) = after.split_once('>').unwrap();
        assert_eq!(tag.matches('"').count() % 2, 0, "{tag}");
        if let Some(name) = tag.strip_prefix('/') {
            assert_eq!(open.pop(), Some(name), "{document}");
        } else {
            if !tag.ends_with('/') {
                open.push(tag.split(' ').next().unwrap());
            }
            found.push(tag);
        }
        rest = after;
    }
    assert!(open.is_empty() && rest.trim().is_empty(), "{open:?} {rest}");
    assert!(found[0].starts_with("svg width=\"900\""), "{}", found[0]);
    assert_eq!(found.iter().filter(|tag| tag.starts_with("svg")).count(), 2, "the picture and the plot in it");
    found
}

/// Value of an attribute of a tag.
fn attribute<'a>(tag: &'a str, name: &str) -> &'a str {
    tag.split_once(&format!(" {name}=\"")).unwrap().1.split('"').next().unwrap()
}

/// Points of the polylines in `color`, in the document's unit.
fn polylines(document: &str, color: Color) -> Vec<Vec<[f64; 2]>> {
    let [r, g, b] = color.rgb();
    let stroke = format!("stroke=\"#{r:02X}{g:02X}{b:02X}\"");
    let point = |pair: &str| {
        let (x, y) = pair.split_once(',').unwrap();
        [x.parse().unwrap(), y.parse().unwrap()]
    };
    let lines = tags(document).into_iter().filter(|tag| tag.starts_with("polyline") && tag.contains(&stroke));
    lines.map(|tag| attribute(tag, "points").split_whitespace().map(point).collect()).collect()
}

#[test]
fn circles_on_a_map_are_round_with_the_given_radius() {
    for far in [[400.0, 100.0], [30.0, 300.0], [200.0, 200.0]] {
        let circle = Layer::new("", Mark::Circles { radius: 25.0 }, Color::Red, [[60.0, 40.0]]);
        let ruler = Layer::new("", Mark::Line, Color::Blue, [[0.0, 0.0], [far[0], 0.0]]);
        let plumb = Layer::new("", Mark::Line, Color::Green, [[0.0, 0.0], [0.0, far[1]]]);
        let document = svg(&chart(true, vec![circle, ruler, plumb]));
        let [ruler, plumb] = [Color::Blue, Color::Green].map(|color| polylines(&document, color)[0].clone());
        let unit_x = (ruler[1][0] - ruler[0][0]) / far[0];
        let unit_y = (plumb[0][1] - plumb[1][1]) / far[1];
        assert!((unit_x / unit_y - 1.0).abs() < 2e-3, "{unit_x} {unit_y}");
        let outline = *tags(&document).iter().find(|tag| tag.starts_with("ellipse")).unwrap();
        let [cx, cy, rx, ry] = ["cx", "cy", "rx", "ry"].map(|name| attribute(outline, name).parse::<f64>().unwrap());
        let center = [ruler[0][0] + 60.0 * unit_x, ruler[0][1] - 40.0 * unit_y];
        assert!((cx - center[0]).hypot(cy - center[1]) < 0.3 && rx == ry, "{outline}");
        assert!((rx / (25.0 * unit_x) - 1.0).abs() < 5e-3, "{rx} {}", 25.0 * unit_x);
    }
}

#[test]
fn every_label_is_there_and_escaped() {
    let mut chart = chart(true, every_mark(&[[0.0, 0.5], [30.0, 40.0]]));
    chart.title = "a < b & \"c\"\nand\u{1}more".into();
    chart.layers[0].label = "<line> & co".into();
    let document = svg(&chart);
    let texts = tags(&document).iter().filter(|tag| tag.starts_with("text")).count();
    assert!(document.contains("a &lt; b &amp; \"c\" andmore"), "{document}");
    assert!(document.contains("&lt;line&gt; &amp; co"));
    for layer in &chart.layers[1..] {
        assert!(document.contains(&layer.label), "{}", layer.label);
    }
    for label in ["x (mm)", "y (mm)"] {
        assert_eq!(document.matches(label).count(), 1, "{label}");
    }
    assert!(texts > 2 + chart.layers.len() + 8, "title, labels of axes and layers, numbers");
}

#[test]
fn nothing_is_drawn_outside_a_given_range() {
    let far = [[-500.0, -20.0], [3.0, 4.0], [900.0, 70.0], [5.0, -1e90], [2.0, 2.0]];
    let mut chart = chart(false, every_mark(&far));
    (chart.x.range, chart.y.range) = (Some([0.0, 10.0]), Some([0.0, 5.0]));
    let document = svg(&chart);
    // the nested picture is cut off at its rim
    let (axes, after) = document.split_once("<svg x=").unwrap();
    let (plot, legend) = after.split_once("</svg>").unwrap();
    let strokes = |part: &str| part.matches("stroke-width=").count();
    assert!(strokes(axes) == 0 && strokes(plot) > 8 && !legend.contains("<svg"), "{document}");
    let numbers = plot.split([' ', '"', ',', 'M', 'L']).filter_map(|word| word.parse::<f64>().ok());
    assert!(numbers.into_iter().all(|number| number.abs() < 2e6), "{plot}");
    assert_eq!(plot.matches("<circle").count(), 2, "of the dots those within the range");
}

#[test]
fn a_logarithmic_axis_has_equal_ratios_at_equal_distances_and_gaps_at_zero() {
    let points = [[1.0, 0.01], [10.0, 0.1], [100.0, 0.0], [1000.0, 10.0], [1e4, 100.0]];
    let mut chart = chart(false, vec![Layer::new("", Mark::Line, Color::Red, points)]);
    (chart.x, chart.y) = (Axis::log("x"), Axis::log("y"));
    let document = svg(&chart);
    let lines = polylines(&document, Color::Red);
    assert_eq!(lines.iter().map(Vec::len).collect::<Vec<_>>(), [2, 2], "broken at zero");
    let [[a, b], [c, d]] = [[lines[0][0], lines[0][1]], [lines[1][0], lines[1][1]]];
    for axis in [0, 1] {
        let decade = b[axis] - a[axis];
        assert!((d[axis] - c[axis] - decade).abs() < 0.3 && decade.abs() > 50.0, "{lines:?}");
    }
    assert!((c[0] - b[0] - 2.0 * (b[0] - a[0])).abs() < 0.4, "{lines:?}");
    for number in ["0.01", "0.1", "10", "100", "1000", "10000"] {
        assert!(document.contains(&format!(">{number}<")), "{number} in {document}");
    }
    chart.layers[0].points = vec![[0.0, -1.0], [f64::NAN, 3.0]];
    tags(&svg(&chart));
}

fn any_number() -> impl Strategy<Value = f64> {
    prop_oneof![-100.0..100.0f64, any::<f64>(), Just(f64::NAN), Just(f64::INFINITY), Just(f64::NEG_INFINITY), Just(0.0)]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(128))]

    #[test]
    fn no_numbers_make_it_panic(
        points in proptest::collection::vec(proptest::array::uniform2(any_number()), 0..12),
        [size, low, high] in proptest::array::uniform3(any_number()),
        map: bool,
        ranged: bool,
        log: bool,
    ) {
        let mut layers = every_mark(&points);
        for layer in &mut layers {
            match &mut layer.mark {
                Mark::Circles { radius } => *radius = size,
                Mark::Cells { side, .. } => *side = size,
                _ => {}
            }
        }
        let mut chart = chart(map, layers);
        chart.x.range = ranged.then_some([low, high]);
        if log {
            (chart.x.is_log, chart.y.is_log) = (true, true);
        }
        tags(&svg(&chart));
    }
}
