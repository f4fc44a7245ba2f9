use upm_core::geometry::Twist;
use upm_core::signal::{TwistHarmonic, TwistWave};

/// Root mean square, over plate and period, of the speed difference between `measured` and `asked`, relative to
/// `asked`.
pub(super) fn off_part(measured: &TwistWave, asked: &TwistWave, side_m: f64) -> f64 {
    let at = |wave: &TwistWave, k: usize| wave.harmonics.get(k).copied().unwrap_or_default();
    let count = measured.harmonics.len().max(asked.harmonics.len());
    let off = (0..count).map(|k| (at(measured, k), at(asked, k)));
    let off = off.map(|(a, b)| TwistHarmonic { cos: a.cos - b.cos, sin: a.sin - b.sin });
    let of_asked = asked.harmonics.iter().copied();
    (off.map(|h| square(h, side_m)).sum::<f64>() / of_asked.map(|h| square(h, side_m)).sum::<f64>()).sqrt()
}

/// Twice the mean square of a harmonic's speed over a square plate of side `side_m`, (m/s)².
fn square(harmonic: TwistHarmonic, side_m: f64) -> f64 {
    // the mean of |p|² over the square is side²/6
    let of = |twist: Twist| twist.velocity_mps.norm_squared() + (twist.spin_radps * side_m).powi(2) / 6.0;
    of(harmonic.cos) + of(harmonic.sin)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use upm_core::geometry::Vec2;

    fn wave(v: &[[f64; 6]]) -> TwistWave {
        let twist = |v: &[f64]| Twist::new(v[0], v[1], 10.0 * v[2]);
        let harmonics = v.iter().map(|v| TwistHarmonic { cos: twist(&v[..3]), sin: twist(&v[3..]) });
        TwistWave { base_radps: std::f64::consts::TAU, harmonics: harmonics.collect() }
    }

    fn numbers() -> impl Strategy<Value = Vec<[f64; 6]>> {
        proptest::collection::vec(proptest::array::uniform6(-1.0..1.0f64), 1..4)
    }

    proptest! {
        /// Compares with sums over a grid of points and moments.
        #[test]
        fn it_is_that_of_the_whole_plate(asked in numbers(), measured in numbers()) {
            let (asked, measured, side_m) = (wave(&asked), wave(&measured), 0.24);
            let grid = || (0..400).map(|i| Vec2::new(f64::from(i % 20) - 9.5, f64::from(i / 20) - 9.5) * (side_m / 20.0));
            let (mut off, mut whole) = (0.0, 0.0);
            for t_s in (0..32).map(|i| f64::from(i) / 32.0) {
                let (a, m) = (asked.at(t_s), measured.at(t_s));
                off += grid().map(|p| (m - a).velocity_at(p).norm_squared()).sum::<f64>();
                whole += grid().map(|p| a.velocity_at(p).norm_squared()).sum::<f64>();
            }
            let part = off_part(&measured, &asked, side_m);
            prop_assert!((part / (off / whole).sqrt() - 1.0).abs() < 3e-3, "{part}");
        }
    }
}
