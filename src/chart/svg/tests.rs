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
