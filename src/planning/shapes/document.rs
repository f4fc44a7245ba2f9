use kurbo::{Affine, Point};
use usvg::roxmltree::{Document, ParsingOptions};
use usvg::tiny_skia_path::{self, PathSegment};
use usvg::{Group, ImageHrefResolver, Node, Options, Transform, Tree};

use super::survey::{PATTERN, beside_paths};

/// Style over that of the document, of every element: what changes no outline, and may take any amount of memory.
const PLAIN: &str = "* { background-color: none !important; clip-path: none !important; filter: none !important; \
    marker: none !important; mask: none !important; stroke-dasharray: none !important; stroke-linejoin: bevel !important }";

/// Path data of all outlines that a browser draws from an SVG document, in the order in which it does, and in words
/// what is in the document beside `path` elements; no words if there is nothing else.
///
/// # Errors
/// A message about the first fault of the document.
pub fn path_data_of(document: &str) -> Result<(String, String), String> {
    if document.contains("<!ENTITY") {
        return Err("entities of its own: save it as plain SVG".to_owned());
    }
    let options = ParsingOptions { allow_dtd: true, ..ParsingOptions::default() };
    let text = document.replace("<pattern", &format!("<{PATTERN}")).replace("</pattern", &format!("</{PATTERN}"));
    let document = Document::parse_with_options(&text, options).map_err(|error| error.to_string())?;
    let beside = beside_paths(&document)?;
    // files and data that images name are not read
    let image_href_resolver =
        ImageHrefResolver { resolve_data: Box::new(|_, _, _| None), resolve_string: Box::new(|_, _| None) };
    let options = Options { image_href_resolver, style_sheet: Some(PLAIN.to_owned()), ..Options::default() };
    let tree = Tree::from_xmltree(&document, &options).map_err(|error| error.to_string())?;
    let mut d = String::new();
    let beside = match append(tree.root(), Affine::IDENTITY, &mut d) {
        true if beside.is_empty() => CLIPPED.to_owned(),
        true => format!("{beside}, {CLIPPED}"),
        false => beside,
    };
    if d.pop().is_none() {
        let beside = if beside.is_empty() { "no shapes" } else { &beside };
        return Err(format!("nothing drawn ({beside})"));
    }
    Ok((d, beside))
}

/// Told where a viewport, which clips its content, is smaller than that.
const CLIPPED: &str = "edge of a viewport left out";

/// Appends the visible paths of `group`, in the coordinates to which `to_page` leads from those around the group. True
/// where a browser clips some of them.
fn append(group: &Group, to_page: Affine, d: &mut String) -> bool {
    if group.opacity().get() == 0.0 {
        return false;
    }
    let outline = group.bounding_box();
    let mut is_clipped =
        group.clip_path().is_some_and(|clip| clip.root().bounding_box().intersect(&outline) != Some(outline));
    let Transform { sx, kx, ky, sy, tx, ty } = group.transform();
    let to_page = to_page * Affine::new([sx, ky, kx, sy, tx, ty].map(f64::from));
    for child in group.children() {
        match child {
            Node::Group(group) => is_clipped |= append(group, to_page, d),
            Node::Path(path) if path.is_visible() => {
                path.data().segments().for_each(|segment| d.push_str(&written(segment, to_page)));
            }
            Node::Path(_) | Node::Image(_) | Node::Text(_) => {}
        }
    }
    is_clipped
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Path data of a drawing with this content, and what is in it beside paths.
    fn drawn(content: &str) -> Result<(String, String), String> {
        path_data_of(&format!(r#"<svg xmlns="http://www.w3.org/2000/svg">{content}</svg>"#))
    }

    /// Path data of a drawing of plain paths.
    fn outlines(content: &str) -> String {
        let (d, beside) = drawn(content).unwrap();
        assert_eq!(beside, "", "{content}");
        d
    }

    #[test]
    fn transforms_of_groups_are_carried_out() {
        let document = r#"<?xml version="1.0"?><!DOCTYPE svg>
            <svg xmlns="http://www.w3.org/2000/svg"><defs><path d="M9 9 H8"/></defs>
            <g transform="translate(10 0)"><path transform="scale(2)" d="M0 0 h1"/></g><path d="M0 0 V5"/></svg>"#;
        assert_eq!(path_data_of(document).unwrap().0, "M10,0 L12,0 M0,0 L0,5");
        let turned = r#"<path transform="rotate(90)" transform-origin="10 0" d="M0 0 H1"/>"#;
        assert_eq!(outlines(turned), "M10,-10 L10,-9");
    }

    #[test]
    fn numbers_stay_as_they_are_written() {
        assert_eq!(
            outlines(r#"<path d="M0.1 0.2 L1e-3 123.456 Q1.7 2.3 3.9 4.1"/>"#),
            "M0.1,0.2 L0.001,123.456 Q1.7,2.3 3.9,4.1"
        );
        assert_eq!(outlines(r#"<path d="M1 1 C2.5 3 4 5 6 7.25 Z"/>"#), "M1,1 C2.5,3 4,5 6,7.25 Z");
    }

    #[test]
    fn backgrounds_are_no_outlines_and_clipped_edges_are_told() {
        let page = |style: &str| {
            let path = r#"<path d="M0 0 H5"/>"#;
            path_data_of(&format!(
                r#"<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 9 9" style="{style}">{path}</svg>"#
            ))
        };
        assert_eq!(page("background-color:#fff"), page(""));
        let within = |side: u8| {
            drawn(&format!(r#"<svg width="{side}" height="{side}"><path d="M0 0 H5"/></svg>"#))
                .map(|(_, beside)| beside)
        };
        assert_eq!([within(3), within(9)], [Ok(CLIPPED.to_owned()), Ok(String::new())]);
        assert!(drawn(r#"<g opacity="0"><path d="M0 0 H5"/></g>"#).is_err());
    }

    #[test]
    fn style_sheets_and_links_take_no_time_or_memory_without_bound() {
        let styled = |sheet: &str| drawn(&format!("<style>{sheet}</style><path d='M0 0 H5'/>"));
        assert!(styled("z g g g path{fill:none}").unwrap_err().contains("a selector of more than 3"));
        for sheet in ["/* a b c d e { */ g > g > g > path{fill:none}", "@media screen and (width: 3px) {.a{fill:none}}"]
        {
            assert!(styled(sheet).is_ok(), "{sheet}");
        }
        for link in [r##"q:href="#none" xlink:href"##, r##"xlink:href="#none" href"##] {
            let doubled = |k: u8| {
                let copy = format!(r##"<use {link}="#g{}"/>"##, k.saturating_sub(1));
                format!(r#"<g id="g{k}">{copy}{copy}</g>"#)
            };
            let groups: String = (1..30).map(doubled).collect();
            let spaces = r#"xmlns:q="urn:q" xmlns:xlink="http://www.w3.org/1999/xlink""#;
            let fault = drawn(&format!(r#"<g {spaces}><path id="g0" d="M0 0 H5"/>{groups}</g>"#)).unwrap_err();
            assert!(fault.contains("too many with copies"), "{link}: {fault}");
        }
        assert!(drawn("<text><tref/></text><path d='M0 0 H5'/>").is_err());
    }

    #[test]
    fn what_a_browser_does_not_draw_is_not_there() {
        for hidden in [
            r#"<g style="display:none"><path d="M500 500 H900"/></g>"#,
            r#"<path display="none" d="M500 500 H900"/>"#,
            r#"<style>.g{display:none}</style><path class="g" d="M500 500 H900"/>"#,
            r#"<x:path xmlns:x="urn:x" d="M500 500 H900"/>"#,
            r#"<path visibility="hidden" d="M500 500 H900"/>"#,
            r#"<path fill="none" d="M500 500 H900"/>"#,
            r#"<symbol><path d="M500 500 H900"/></symbol>"#,
            r#"<switch><g/><path d="M500 500 H900"/></switch>"#,
        ] {
            assert_eq!(outlines(&format!(r#"{hidden}<path d="M0 0 H100 V50"/>"#)), "M0,0 L100,0 L100,50", "{hidden}");
        }
        for fault in ["<path fill='none' d='M0 0 H5'/>", "<path d='M0 0'/>", "<g/>"] {
            assert!(drawn(fault).unwrap_err().contains("nothing drawn (no shapes)"), "{fault}");
        }
        assert!(drawn("<text>A</text>").unwrap_err().contains("nothing drawn (text left out)"));
        assert!(path_data_of("M0 0 H3").is_err());
        assert!(path_data_of("<html><path d='M0 0 H3'/></html>").is_err());
    }

    #[test]
    fn copies_and_viewports_are_where_a_browser_places_them() {
        let copied = r##"<path id="p" d="M0 0 H100 V50"/><use href="#p" x="300"/>"##;
        assert_eq!(outlines(copied), "M0,0 L100,0 L100,50 M300,0 L400,0 L400,50");
        let symbol = r##"<symbol id="s" viewBox="0 0 10 10" overflow="visible"><path d="M0 0 H10"/></symbol>
            <use href="#s" width="20" height="20" transform="translate(5 0)"/>"##;
        assert_eq!(outlines(symbol), "M5,0 L25,0");
        let nested = r#"<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 400 400">
            <svg x="200" y="200" width="100" height="100" viewBox="0 0 10 10"><path d="M0 0 H10 V5"/></svg>
            <path d="M0 0 H100"/></svg>"#;
        assert_eq!(path_data_of(nested).unwrap().0, "M200,200 L300,200 L300,250 M0,0 L100,0");
        let stretched = r#"<svg xmlns="http://www.w3.org/2000/svg" width="200" height="100" viewBox="0 0 100 100"
            preserveAspectRatio="none"><path d="M0 0 H100 V50"/></svg>"#;
        assert_eq!(path_data_of(stretched).unwrap().0, "M0,0 L200,0 L200,50");
    }

    #[test]
    fn shapes_are_drawn_and_told() {
        let shapes = r#"<rect x="1" y="2" width="3" height="4"/><polyline points="0,0 5,5" fill="red"/>"#;
        let (d, beside) = drawn(shapes).unwrap();
        assert_eq!(d, "M1,2 L4,2 L4,6 L1,6 Z M0,0 L5,5");
        assert_eq!(beside, "polyline taken as an outline, rect taken as an outline");
        let (d, _) = drawn(r#"<circle cx="5" cy="5" r="2"/>"#).unwrap();
        assert!(d.starts_with("M7,5 C") && d.ends_with('Z'), "{d}");
    }

    #[test]
    fn what_is_left_out_is_told() {
        let path = r#"<path d="M0 0 H5"/>"#;
        for (content, told) in [
            ("<text>A</text>", "text left out"),
            ("<image href='/dev/zero' width='1' height='1'/>", "image left out"),
            ("<path mask='url(#m)' d='M0 0 H5'/>", "mask left out"),
            ("<defs><pattern id='p'><g fill='url(#p)'><rect/></g></pattern></defs>", "fill-pattern left out"),
            ("<path style='fill:red; marker-end: url(#m)' d='M0 0 H5'/>", "marker-end left out"),
            ("<style>path { clip-path: url(#c) }</style>", "clip-path left out"),
            ("<style>path { cx: 3px }</style>", "cx left out"),
            ("<symbol><path transform-origin='50% 0'/></symbol>", "shares of a symbol's size left out"),
            ("<x:text xmlns:x='urn:x'>A</x:text>", ""),
            ("<path style='transform: rotate(3deg)' d='M0 0 H5'/>", "transform left out"),
            ("<path d='M0 0 H5 L'/>", "path data left out from a fault on"),
            ("<path style='filter:none' clip-path='none' d='M0 0 H5'/>", ""),
            ("<defs><text>A</text></defs><g display='none'><text>A</text></g>", ""),
        ] {
            assert_eq!(drawn(&format!("{path}{content}")).unwrap().1, told, "{content}");
        }
    }

    #[test]
    fn documents_that_grow_without_bound_are_refused() {
        let mut bomb = r#"<path id="u0" d="M0 0 H1"/>"#.to_owned();
        for i in 0..30 {
            bomb += &format!(r##"<g id="u{}"><use href="#u{i}"/><use href="#u{i}"/></g>"##, i + 1);
        }
        let long = format!(r#"<path id="p" d="M0 0{}"/>"#, " H1 V1".repeat(100_000));
        let deep = "<g>".repeat(200) + &"</g>".repeat(200);
        for (content, found) in [
            (bomb, "copies"),
            (long + &r##"<use href="#p"/>"##.repeat(100), "copies"),
            (deep, "deep"),
            (r##"<g id="g"><use href="#g"/></g>"##.to_owned(), "deep"),
            (r##"<linearGradient id="a" href="#b"/><linearGradient id="b" href="#a"/>"##.to_owned(), "deep"),
            (format!("<linearGradient>{0}</linearGradient>{0}", "<stop/>".repeat(5_000)), "gradients"),
            ("<s:pattern xmlns:s='http://www.w3.org/2000/svg'/>".to_owned(), "patterns"),
        ] {
            assert!(drawn(&content).unwrap_err().contains(found), "{found}");
        }
        assert!(path_data_of("<!DOCTYPE svg [<!ENTITY a 'b'>]><svg/>").unwrap_err().contains("entities"));
    }
}
