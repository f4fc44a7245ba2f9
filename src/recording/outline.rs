use upm_core::geometry::Vec2;
use upm_perception::vision::Table;

/// The table's rim in the picture as a closed line, px. Its sides are curved where the lens bends them.
pub fn outline_px(table: &Table) -> impl Iterator<Item = Vec2> {
    const STEPS: usize = 16;
    let h = table.side_m / 2.0;
    let corners = [(-h, h), (h, h), (h, -h), (-h, -h)].map(|(x, y)| Vec2::new(x, y * table.aspect));
    (0..=4 * STEPS).map(move |i| {
        let (from, to) = (corners[i / STEPS % 4], corners[(i / STEPS + 1) % 4]);
        let p_m = from.lerp(&to, (i % STEPS) as f64 / STEPS as f64);
        table.lens.image_from_ideal(table.ideal_from_table.apply(p_m))
    })
}
