use std::str::FromStr;

use kurbo::{Affine, BezPath};
use roxmltree::{Document, Node, ParsingOptions};

use super::svg::parsed;

/// Most nodes of a document; larger ones are rejected.
const MOST_NODES: u32 = 100_000;

/// Elements whose content is not drawn where it is defined.
const NOT_DRAWN: [&str; 6] = ["defs", "clipPath", "mask", "marker", "pattern", "symbol"];

/// Path data of every `path` element of an SVG document in document order, with its transforms applied.
///
/// # Errors
/// A message about the first fault of the document.
pub fn path_data_of(document: &str) -> Result<String, String> {
    let options = ParsingOptions { allow_dtd: true, nodes_limit: MOST_NODES, ..ParsingOptions::default() };
    let document = Document::parse_with_options(document, options).map_err(|error| error.to_string())?;
    let drawn = document.descendants().filter(|node| is_element(*node, "path") && !is_hidden(*node));
    let mut whole = BezPath::new();
    for node in drawn {
        let Some(d) = node.attribute("d") else { continue };
        let path = parsed(d).map_err(|error| format!("a path with {error}"))?;
        whole.extend(transform_of(node)? * path);
    }
    if whole.is_empty() {
        return Err("no path element (a drawing program turns shapes and text into paths)".to_owned());
    }
    Ok(whole.to_svg())
}

/// True for an element of this name, in the namespace of SVG or without one.
fn is_element(node: Node<'_, '_>, name: &str) -> bool {
    node.is_element() && node.tag_name().name() == name
}

fn is_hidden(node: Node<'_, '_>) -> bool {
    node.ancestors().any(|above| NOT_DRAWN.iter().any(|name| is_element(above, name)))
}

/// Transform from the coordinates of `node` to those of the document.
fn transform_of(node: Node<'_, '_>) -> Result<Affine, String> {
    let mut written = node.ancestors().filter_map(|above| above.attribute("transform"));
    written.try_fold(Affine::IDENTITY, |inner, text| {
        let svgtypes::Transform { a, b, c, d, e, f } =
            svgtypes::Transform::from_str(text).map_err(|error| format!("a transform with {error}"))?;
        Ok(Affine::new([a, b, c, d, e, f]) * inner)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn transforms_of_groups_are_carried_out() {
        let document = r#"<?xml version="1.0"?><!DOCTYPE svg>
            <svg xmlns="http://www.w3.org/2000/svg"><defs><path d="M9 9 H8"/></defs>
            <g transform="translate(10 0)"><path transform="scale(2)" d="M0 0 h1"/></g><path d="M0 0 V5"/></svg>"#;
        assert_eq!(path_data_of(document).unwrap(), "M10,0 L12,0 M0,0 L0,5");
    }

    #[test]
    fn documents_without_paths_are_refused() {
        assert!(path_data_of("<svg><rect width='3' height='4'/></svg>").unwrap_err().contains("no path element"));
        assert!(path_data_of("<svg><path d='M0 0 L'/></svg>").unwrap_err().contains("a path with"));
        assert!(path_data_of("M0 0 H3").is_err());
    }
}
