use kurbo::{Affine, Point};
use usvg::roxmltree::{Document, ParsingOptions};
use usvg::tiny_skia_path::{self, PathSegment};
use usvg::{Group, ImageHrefResolver, Node, Options, Transform, Tree};

use super::survey::beside_paths;

/// Style over that of the document, of every element: what changes no outline, and may take any amount of memory.
const PLAIN: &str = "* { clip-path: none !important; filter: none !important; marker: none !important; \
    mask: none !important; stroke-dasharray: none !important; stroke-linejoin: bevel !important }";

/// Path data of all outlines that a browser draws from an SVG document, in the order in which it does, and in words
/// what is in the document beside `path` elements; no words if there is nothing else.
///
/// # Errors
/// A message about the first fault of the document.
pub fn path_data_of(document: &str) -> Result<(String, String), String> {
    if document.contains("<!ENTITY") {
        return Err("entities of its own".to_owned());
    }
    let options = ParsingOptions { allow_dtd: true, ..ParsingOptions::default() };
    let document = Document::parse_with_options(document, options).map_err(|error| error.to_string())?;
    let beside = beside_paths(&document)?;
    // files and data that images name are not read
    let image_href_resolver =
        ImageHrefResolver { resolve_data: Box::new(|_, _, _| None), resolve_string: Box::new(|_, _| None) };
    let options = Options { image_href_resolver, style_sheet: Some(PLAIN.to_owned()), ..Options::default() };
    let tree = Tree::from_xmltree(&document, &options).map_err(|error| error.to_string())?;
    let mut d = String::new();
    append(tree.root(), Affine::IDENTITY, &mut d);
    if d.is_empty() {
        let beside = if beside.is_empty() { "no shapes" } else { &beside };
        return Err(format!("nothing drawn ({beside})"));
    }
    d.pop();
    Ok((d, beside))
}

/// Appends the visible paths of `group`, in the coordinates to which `to_page` leads from those around the group.
fn append(group: &Group, to_page: Affine, d: &mut String) {
    let Transform { sx, kx, ky, sy, tx, ty } = group.transform();
    let to_page = to_page * Affine::new([sx, ky, kx, sy, tx, ty].map(f64::from));
    for child in group.children() {
        match child {
            Node::Group(group) => append(group, to_page, d),
            Node::Path(path) if path.is_visible() => {
                path.data().segments().for_each(|segment| d.push_str(&written(segment, to_page)));
            }
            Node::Path(_) | Node::Image(_) | Node::Text(_) => {}
        }
    }
}

/// The segment as path data. Numbers of a path without transforms stay as they are, to seven digits.
fn written(segment: PathSegment, to_page: Affine) -> String {
    let at = |point: tiny_skia_path::Point| {
        let Point { x, y } = to_page * Point::new(point.x.into(), point.y.into());
        format!("{},{}", x as f32, y as f32)
    };
    match segment {
        PathSegment::MoveTo(to) => format!("M{} ", at(to)),
        PathSegment::LineTo(to) => format!("L{} ", at(to)),
        PathSegment::QuadTo(by, to) => format!("Q{} {} ", at(by), at(to)),
        PathSegment::CubicTo(from, by, to) => format!("C{} {} {} ", at(from), at(by), at(to)),
        PathSegment::Close => "Z ".to_owned(),
    }
}
