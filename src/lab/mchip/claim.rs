//! Classes of the figures: reproduced, or not.

use crate::Figure;

impl Figure {
    /// The figure classed in its source, so that the printed table names it: reproduced where the measured value is in
    /// `accepted`, limits included; a missing one is not.
    pub(super) fn judged(self, accepted: [f64; 2]) -> Self {
        let [least, most] = accepted;
        let verdict = if (least..=most).contains(&self.measured) { "reproduced" } else { "NOT reproduced" };
        Self { source: format!("{verdict} ({least} to {most}): {}", self.source), ..self }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figure_in_the_accepted_interval_alone_is_reproduced() {
        for (measured, class) in [
            (0.6, "reproduced (0.6 to 1): Fig. 5"),
            (1.1, "NOT reproduced (0.6 to 1): Fig. 5"),
            (f64::NAN, "NOT reproduced (0.6 to 1): Fig. 5"),
        ] {
            let figure = Figure::against("rate", "mm/s", measured, 0.8, "Fig. 5").judged([0.6, 1.0]);
            assert_eq!(figure.source, class);
        }
    }
}
