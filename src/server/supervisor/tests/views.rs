//! Pictures and live streams of a plate.

use super::*;

#[test]
fn plate_has_its_own_live_stream_if_configured() {
    let test_plates = TestPlates::new();
    let plates = test_plates.open_with(None, |around| around.live_history_bytes = Some(16 << 20));
    let plate = plates.get("one").unwrap();
    let live = plate.snapshot().live.unwrap();
    let address = live.strip_prefix("rerun+http://").and_then(|rest| rest.strip_suffix("/proxy")).unwrap();
    assert!(address.starts_with("127.0.0.1:") && std::net::TcpStream::connect(address).is_ok(), "{live}");
    let id = test_plates.submit(plate, TWO_COINS, Pace::Max);
    let ended = test_plates.ended(&id);
    assert_eq!((ended.state, ended.recording), (JobState::Completed, RecordingStatus::None), "no file comes of it");
    assert_eq!(plates.shutdown(LONG), Vec::<String>::new());
}

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
