/// Mean width of a letter, in sizes; on the wide side of what common fonts have.
const LETTER: f64 = 0.58;

/// Estimated width of `text` in letters of size `size_px`, px.
pub(super) fn width_px(text: &str, size_px: f64) -> f64 {
    LETTER * size_px * text.chars().count() as f64
}

/// The text on one line, without characters that no document may hold.
pub(super) fn plain(text: &str) -> String {
    let allowed = |c: char| !c.is_control() && !('\u{fffe}'..='\u{ffff}').contains(&c);
    text.chars().map(|c| if c.is_whitespace() { ' ' } else { c }).filter(|&c| allowed(c)).collect()
}

/// The text broken between words into lines of at most `width` px; longer words stand alone.
pub(super) fn lines(text: &str, size_px: f64, width: f64) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in plain(text).split(' ').filter(|word| !word.is_empty()) {
        match lines.last_mut() {
            Some(line) if width_px(line, size_px) + width_px(word, size_px) + LETTER * size_px <= width => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}
