use super::*;

fn read(api: &TestApi, row: &JobRow) -> ApiAnswer {
    api.get(&format!("/v1/jobs/{}/recording", row.id))
}

/// A job with a recording, which ended so.
fn recorded(api: &TestApi, recording: RecordingStatus) -> (JobRow, PathBuf) {
    let row = api.queue();
    let file = api.begin().join("run.rrd");
    std::fs::write(&file, "RRF2").unwrap();
    api.end(&row, JobState::Completed, recording);
    (row, file)
}

#[test]
fn only_what_was_recorded_is_served() {
    let api = TestApi::stopped();
    let row = api.queue();
    assert_eq!(read(&api, &row).status, 404, "it has not begun");
    api.begin();
    assert_eq!(read(&api, &row).status, 409, "it is being written");
    api.end(&row, JobState::Completed, RecordingStatus::None);
    assert_eq!(read(&api, &row).status, 404);
    for kept in [RecordingStatus::Failed, RecordingStatus::Partial, RecordingStatus::Whole] {
        let (row, file) = recorded(&api, kept);
        let seen = read(&api, &row);
        assert_eq!((&seen.body[..], seen.header("content-length")), (&b"RRF2"[..], "4"));
        assert_eq!(seen.header("content-disposition"), "attachment; filename=\"rest.rrd\"");
        std::fs::rename(&file, file.with_file_name("elsewhere")).unwrap();
        assert_eq!(read(&api, &row).status, 404, "the recording is gone");
        std::os::unix::fs::symlink("elsewhere", &file).unwrap();
        assert_eq!(read(&api, &row).status, 409, "a link may leave the folder");
    }
}
