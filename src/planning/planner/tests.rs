use super::Reach;
use super::fixture::{library, mm};

#[test]
fn reach_reports_the_weakest_direction() {
    let everywhere = Reach::of(&library(), mm(20.0, 30.0));
    assert!(everywhere.weakest_projection > 0.9 && everywhere.singular_values[1] > 1.0);
    let mut along_x = (*library()).clone();
    along_x.entries = vec![along_x.entries[289].clone()];
    let reach = Reach::of(&along_x, mm(20.0, 30.0));
    assert!(reach.weakest_direction.x.abs() < 0.02 && reach.weakest_projection < 0.02);
    assert!(reach.singular_values[0] > 0.5 && reach.singular_values[1] < 1e-9);
}
