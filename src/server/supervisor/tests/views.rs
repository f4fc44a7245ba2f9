//! Pictures of a plate.

use super::*;

#[test]
fn pictures_are_made_on_request() {
    let test_plates = TestPlates::new();
    let plates = test_plates.open(None);
    let plate = plates.get("one").unwrap();
    assert_eq!(plate.picture(), None);
    test_plates.submit(plate, HOLD, Pace::RealTime);
    let (png, age) = eventually("a picture", || plate.picture());
    assert!(age <= Duration::from_secs(3), "{age:?}");
    let image = image::load_from_memory(&png).unwrap().into_rgb8();
    assert_eq!(image.dimensions(), (640, 512));
    assert!(image.pixels().any(|p| p.0 == [0, 220, 90]), "a ring around a part");
    plates.shutdown(LONG);
}

#[test]
fn run_observer_has_no_blocking_call() {
    let source = include_str!("../run_observer.rs");
    for waits in ["lock(", "recv", ".join(", "park", "sleep", "std::fs", "File", "rustix"] {
        assert!(!source.contains(waits), "run_observer.rs is called by the control loop and has `{waits}`");
    }
}
