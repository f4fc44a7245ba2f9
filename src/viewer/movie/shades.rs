use std::ops::RangeInclusive;

/// Number of gray levels in a movie.
pub(super) const GRAYS: u8 = 24;

/// Most colours of a movie: for each one the palette has the colour and its mixture with every gray.
pub(super) const MOST_COLORS: usize = 9;

/// Palette index of a pixel that does not change.
pub(super) const UNCHANGED: u8 = 0;

/// Standard deviations of the noise by which a pixel may differ from the movie without a change of the movie.
const NOISE_SDS: f64 = 4.0;

/// The gray levels of a movie.
pub(super) struct Shades {
    levels: Vec<f64>,
    /// Levels at which a pixel that shows a gray keeps it: those nearest to it, and the noise beside them.
    kept: Vec<RangeInclusive<f64>>,
}

impl Shades {
    /// Gray levels for pictures like `picture`, closer where it has more pixels: as the root of their number. The noise
    /// has these standard deviations.
    pub(super) fn of(picture: &[f64], noise_sd: impl Fn(f64) -> f64) -> Self {
        // one of each, for what the first picture does not show
        let mut pixels = [1.0_f64; 256];
        picture.iter().for_each(|level| pixels[*level as usize & 255] += 1.0);
        let total: f64 = pixels.iter().map(|count| count.sqrt()).sum();
        let (mut levels, mut seen) = (Vec::new(), 0.0);
        for (level, count) in pixels.iter().enumerate() {
            seen += count.sqrt();
            while levels.len() < usize::from(GRAYS) && seen >= (levels.len() as f64 + 0.5) / f64::from(GRAYS) * total {
                levels.push(level as f64 + 0.5);
            }
        }
        let kept = |gray: usize| {
            let noise = NOISE_SDS * noise_sd(levels[gray]);
            let middle = |other: usize| 0.5 * (levels[gray] + levels[other.min(levels.len() - 1)]);
            middle(gray.saturating_sub(1)) - noise..=middle(gray + 1) + noise
        };
        Self { kept: (0..levels.len()).map(kept).collect(), levels }
    }

    /// The gray of a pixel that has shown `shown`: another one only where the noise does not explain the difference.
    pub(super) fn gray(&self, level: f64, shown: Option<u8>) -> u8 {
        let off = |gray: u8| (level - self.levels[usize::from(gray)]).abs();
        let nearest = || (0..GRAYS).min_by(|&a, &b| off(a).total_cmp(&off(b))).unwrap_or_default();
        shown.filter(|&gray| self.kept[usize::from(gray)].contains(&level)).unwrap_or_else(nearest)
    }

    /// Red, green and blue of every palette index: unchanged, the grays, then for each colour its mixtures with them
    /// and the colour.
    pub(super) fn palette(&self, colors: &[[u8; 3]]) -> Vec<u8> {
        let grays = || self.levels.iter().map(|level| *level as u8);
        let mut palette = vec![[0; 3]];
        palette.extend(grays().map(|gray| [gray; 3]));
        for color in colors {
            palette.extend(grays().map(|gray| color.map(|c| u8::midpoint(c, gray))));
            palette.push(*color);
        }
        palette.concat()
    }
}

/// Palette indices of a pixel: the first one, and the step from one gray to the next.
#[derive(Clone, Copy)]
pub(super) struct Ink(u8, u8);

impl Ink {
    /// A pixel that is not drawn over.
    pub(super) const NONE: Self = Self(UNCHANGED + 1, 1);

    /// A pixel in a colour, in half or whole.
    pub(super) fn of(color: usize, is_whole: bool) -> Self {
        let half = 1 + GRAYS + (color % MOST_COLORS) as u8 * (GRAYS + 1);
        if is_whole { Self(half + GRAYS, 0) } else { Self(half, 1) }
    }

    /// Palette index of a gray.
    pub(super) fn index(self, gray: u8) -> u8 {
        self.0 + self.1 * gray
    }
}
