use upm_core::geometry::Vec2;

/// Longest piece of a drawn line, m: a lens bends longer ones visibly.
const PIECE_M: f64 = 0.01;

/// The line with points no farther than [`PIECE_M`] from each other.
pub(crate) fn pieces(line_m: &[Vec2]) -> Vec<Vec2> {
    let between = |pair: &[Vec2]| {
        let (from, to) = (pair[0], pair[1]);
        let count = ((to - from).norm() / PIECE_M).ceil().clamp(1.0, 1000.0) as usize;
        (1..=count).map(move |k| from + (to - from) * (k as f64 / count as f64))
    };
    line_m.first().copied().into_iter().chain(line_m.windows(2).flat_map(between)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_keep_their_corners_and_get_short_pieces() {
        let corners = [Vec2::zeros(), Vec2::new(0.025, 0.0), Vec2::new(0.025, 0.004)];
        let line = pieces(&corners);
        assert_eq!(line.len(), 5);
        assert!(corners.iter().all(|corner| line.iter().any(|point| (point - corner).norm() < 1e-12)));
        assert!(line.windows(2).all(|pair| (pair[1] - pair[0]).norm() <= PIECE_M + 1e-12));
        assert!(pieces(&[]).is_empty());
    }
}
