//! Text in a picture.

/// Size of the title, of labels and of the numbers on the axes, px.
pub(super) const TITLE_PX: f64 = 18.0;
pub(super) const LABEL_PX: f64 = 14.0;
pub(super) const TICK_PX: f64 = 12.5;
/// Mean width of a letter, in letter sizes; a generous estimate for common fonts.
const LETTER: f64 = 0.58;

/// A line of text with letters of `size_px`, its middle at the height of `at`, its start, middle or end there;
/// `attributes` are further ones of the element.
pub(super) fn text([x, y]: [f64; 2], size_px: f64, anchor: &str, attributes: &str, words: &str) -> String {
    let words = plain_text(words).replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;");
    format!(
        "<text x=\"{x:.1}\" y=\"{y:.1}\" dy=\"0.5ex\" text-anchor=\"{anchor}\" font-size=\"{size_px}\"{attributes}>\
         {words}</text>\n"
    )
}

/// Estimated width of `text` in letters of size `size_px`, px.
pub(super) fn text_width_px(text: &str, size_px: f64) -> f64 {
    LETTER * size_px * text.chars().count() as f64
}

/// The text on one line, without characters that are illegal in a document.
fn plain_text(text: &str) -> String {
    let allowed = |c: char| !c.is_control() && !('\u{fffe}'..='\u{ffff}').contains(&c);
    text.chars().map(|c| if c.is_whitespace() { ' ' } else { c }).filter(|&c| allowed(c)).collect()
}

/// The text broken between words into lines of at most `width` px; longer words get a line to themselves.
pub(super) fn text_lines(text: &str, size_px: f64, width: f64) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in plain_text(text).split(' ').filter(|word| !word.is_empty()) {
        match lines.last_mut() {
            Some(line) if text_width_px(line, size_px) + text_width_px(word, size_px) + LETTER * size_px <= width => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}
