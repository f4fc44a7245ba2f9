//! Outline and label of a bin, a rectangle that parts are sorted into.

/// The corners of the rectangle from `min` to `max`, the first one again at the end.
pub fn bin_outline(min: [f64; 2], max: [f64; 2]) -> [[f64; 2]; 5] {
    [min, [max[0], min[1]], max, [min[0], max[1]], min]
}

/// The label of a bin for parts of `kinds`: `bin: dime, penny`.
pub fn bin_label(kinds: &[String]) -> String {
    format!("bin: {}", kinds.join(", "))
}
