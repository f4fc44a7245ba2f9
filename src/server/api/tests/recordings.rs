use super::fake::JOB;
use super::{ApiAnswer, TestApi, request};
use crate::api::Refusal;
use crate::api::files::DOWNLOADS;

async fn read(asked: &TestApi, range: &str) -> ApiAnswer {
    asked.ask(request("GET", &format!("/v1/jobs/{JOB}/recording"), &[("range", range)], "")).await
}

#[tokio::test]
async fn ranges_of_a_recording_put_together_are_the_recording() {
    let asked = TestApi::new();
    let bytes: Vec<u8> = (0..200_000u32).flat_map(u32::to_le_bytes).collect();
    *asked.backend.recording.lock().unwrap() = bytes.clone();
    let whole = read(&asked, "").await;
    assert_eq!((whole.status, whole.header("content-length")), (200, "800000"));
    assert_eq!(whole.header("content-disposition"), "attachment; filename=\"rest.rrd\"");
    assert!(whole.body == bytes);
    let mut joined = Vec::new();
    for range in ["bytes=0-99999", "bytes=100000-799000", "bytes=799001-"] {
        let part = read(&asked, range).await;
        assert_eq!(part.status, 206);
        joined.extend_from_slice(&part.body);
    }
    assert!(joined == bytes);
    assert_eq!(read(&asked, "bytes=799999-").await.header("content-range"), "bytes 799999-799999/800000");
    let outside = read(&asked, "bytes=800000-").await;
    assert_eq!((outside.status, outside.header("content-range")), (416, "bytes */800000"));
}

#[tokio::test]
async fn a_recording_under_way_is_a_conflict_and_downloads_have_an_end() {
    let asked = TestApi::new();
    asked.backend.refuse(Refusal::Conflict("it is still being written".to_owned()));
    assert_eq!(read(&asked, "").await.status, 409);
    *asked.backend.recording.lock().unwrap() = vec![7; 100];
    let path = format!("/v1/jobs/{JOB}/recording");
    let mut held = Vec::new();
    for _ in 0..DOWNLOADS {
        held.push(asked.open(request("GET", &path, &[], "")).await);
    }
    let refused = read(&asked, "").await;
    assert_eq!((refused.status, refused.header("retry-after")), (503, "10"));
    held.pop();
    assert_eq!(read(&asked, "").await.status, 200);
}
