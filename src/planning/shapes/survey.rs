use std::collections::{BTreeSet, HashMap};
use std::str::FromStr;

use usvg::roxmltree::{Document, Node};

use super::svg::parsed;

/// Namespace of SVG; elements of others are not drawn.
const SVG: &str = "http://www.w3.org/2000/svg";
/// Namespace of links in older documents.
const XLINK: &str = "http://www.w3.org/1999/xlink";

/// Most bytes of all elements of a document, with those that `use` copies.
const MOST_BYTES: usize = 16 << 20;

/// Bytes of an element without attributes and text.
const ELEMENT_BYTES: usize = 128;

/// Most elements of a document within each other.
const MOST_DEEP: usize = 100;

/// Most elements in a selector that may be anywhere within each other: the time to match it is a power of the depth.
const MOST_IN_SELECTOR: i32 = 3;

/// Elements whose content is not drawn where it is defined.
const NOT_DRAWN: &str = "defs clipPath fill-pattern filter marker mask";

/// Other name of a pattern, under which it is no part of a drawing: patterns may be within each other without end.
pub(super) const PATTERN: &str = "fill-pattern";

/// Elements beside `path` that have an outline.
const SHAPES: &str = "circle ellipse line polygon polyline rect";

/// Elements and their attributes that are left out.
const LEFT_OUT: &str = "animate animateMotion animateTransform clip-path fill-pattern filter foreignObject image \
    marker-end marker-mid marker-start mask script set text transform-box";

/// Properties that are left out where they are in styles.
const LEFT_OUT_OF_STYLES: &str = "clip-path cx cy d filter height marker marker-end marker-mid marker-start mask r \
    rotate rx ry scale transform-box translate width x y";

fn is_one_of(name: &str, names: &str) -> bool {
    names.split(' ').any(|other| other == name)
}

/// Elements and properties of `document` beside plain paths, in words. Elements are gone through as often as they are
/// drawn, which bounds the memory that drawing them takes.
///
/// # Errors
/// A message where the document is too deep or draws too much.
pub(super) fn beside_paths(document: &Document<'_>) -> Result<String, String> {
    let by_id: HashMap<&str, Node<'_, '_>> =
        document.descendants().rev().filter_map(|node| Some((node.attribute("id")?, node))).collect();
    let sheets = document.descendants().filter(|node| node.tag_name().name() == "style");
    let commented: String = sheets.filter_map(|sheet| sheet.text()).collect();
    let sheets: String =
        commented.split("/*").map(|part| part.split_once("*/").map_or(part, |(_, after)| after)).collect();
    let selectors = sheets.split('{').filter_map(|before| before.rsplit(['}', ';']).next());
    let apart = |word: &str| if word == ">" { -1 } else { 1 };
    let is_slow = |selector: &str| selector.split_whitespace().map(apart).sum::<i32>() > MOST_IN_SELECTOR;
    let is_rule = |selector: &&str| !selector.trim_start().starts_with('@');
    if selectors.filter(is_rule).flat_map(|selectors| selectors.split(',')).any(is_slow) {
        return Err(format!("a selector of more than {MOST_IN_SELECTOR} elements within each other"));
    }
    // few of the rules of a style sheet apply to an element
    let element_bytes = ELEMENT_BYTES + sheets.len() / 8;
    // usvg takes shares of a symbol's size of another length
    let mut values = document.root_element().descendants().skip(1).flat_map(|node| node.attributes());
    let has_shares = values.any(|written| written.value().contains('%') || written.value().contains("center"));
    let (mut bytes, mut stops, mut elements, mut beside) = (0, 0_usize, 0, BTreeSet::new());
    let mut open = vec![(document.root_element(), 0, true, false)];
    while let Some((node, depth, is_drawn, is_gradient)) = open.pop() {
        let name = node.tag_name().name();
        let texts = node.children().filter(Node::is_text).filter_map(|text| text.text());
        let written = node.attributes().map(|written| written.value()).chain(texts);
        let is_gradient = is_gradient || name.ends_with("Gradient");
        let is_drawn =
            is_drawn && !is_gradient && !is_one_of(name, NOT_DRAWN) && node.attribute("display") != Some("none");
        elements += 1;
        bytes += element_bytes + written.map(str::len).sum::<usize>();
        // every element may get a copy of the stops of a gradient
        stops += usize::from(is_gradient);
        let with_copies = stops.saturating_mul(elements).max(bytes + ELEMENT_BYTES * open.len());
        if depth > MOST_DEEP || with_copies > MOST_BYTES || is_one_of(name, "pattern tref") {
            return Err(format!(
                "elements too deep ({MOST_DEEP}) or too many with copies by `use`, gradients, patterns"
            ));
        }
        if is_drawn || name == "style" || name == PATTERN {
            beside.extend((name == "symbol" && has_shares).then(|| "shares of a symbol's size left out".to_owned()));
            look_at(node, &mut beside);
        }
        let links = node.attributes().filter(|link| link.name() == "href" && (name == "use" || is_gradient));
        let link = links.filter(|link| matches!(link.namespace(), None | Some(XLINK))).min_by_key(|l| l.namespace());
        let copied = link.and_then(|link| by_id.get(link.value().trim().strip_prefix('#')?)).copied();
        let children = node.children().filter(|child| matches!(child.tag_name().namespace(), None | Some(SVG)));
        let within = copied.into_iter().chain(children.filter(Node::is_element));
        open.extend(within.map(|child| (child, depth + 1, is_drawn, is_gradient)));
    }
    Ok(beside.into_iter().collect::<Vec<_>>().join(", "))
}

/// Adds what `node` is or has beside plain paths.
fn look_at(node: Node<'_, '_>, beside: &mut BTreeSet<String>) {
    let name = node.tag_name().name();
    beside.extend(is_one_of(name, SHAPES).then(|| format!("{name} taken as an outline")));
    let has_fault = node.attribute("d").is_some_and(|d| parsed(d).is_err());
    beside.extend(has_fault.then(|| "path data left out from a fault on".to_owned()));
    let css = if name == "style" { node.text() } else { node.attribute("style") }.unwrap_or_default();
    let declared = css.split([';', '{', '}']).filter_map(|declaration| declaration.split_once(':'));
    let declared = declared.map(|(name, value)| (name.split_whitespace().last().unwrap_or_default(), value.trim()));
    let declared = declared.map(|(name, value)| (name, value, LEFT_OUT_OF_STYLES));
    let written = node.attributes().map(|written| (written.name(), written.value(), LEFT_OUT));
    for (name, value, left_out) in [(name, "", LEFT_OUT)].into_iter().chain(written).chain(declared) {
        let has_units = name == "transform" && svgtypes::Transform::from_str(value).is_err();
        let is_left_out = !value.starts_with("none") && (has_units || is_one_of(name, left_out));
        beside.extend(is_left_out.then(|| format!("{name} left out")));
    }
}
