//! Jobs named by the beginning or ending of their id, by their name, or as the last one.

use super::daemon_process::{TestDaemon, rest};

#[test]
fn job_is_found_by_either_end_of_its_id_by_its_name_and_as_the_last() {
    let served = TestDaemon::start();
    let jobs: Vec<String> = ["first", "second", "third"].map(|name| served.submit(&rest(name), "max")).into();
    jobs.iter().for_each(|id| drop(served.until_state(id, "completed")));
    let shown = |text: &str| served.status(&["show", text], 0).0;
    assert!(shown("last").starts_with("third on plate "));
    // ids begin with the time, so those of one test share a long prefix
    let is_shared = |text: &str| jobs.iter().filter(|id| id.starts_with(text)).count() > 1;
    for (id, name) in jobs.iter().zip(["first", "second", "third"]) {
        let length = (1..32).find(|&length| !is_shared(&id[..length])).unwrap();
        assert!(shown(&id[..length]).starts_with(&format!("{name} on plate ")), "{id}");
        assert_eq!([shown(&id[26..]), shown(name)], [shown(id), shown(id)]);
        let (watched, _) = served.status(&["watch", &id[..length]], 0);
        assert!(watched.contains(&format!("{name} on plate ")), "{watched}");
        let shared = &id[..length - 1];
        let (stdout, stderr) = served.status(&["cancel", shared], 2);
        assert!(stdout.is_empty() && stderr.lines().count() == 1, "{stderr}");
        assert!(stderr.starts_with("upm: ID: expected more digits of one of "), "{stderr}");
        assert!(jobs.iter().filter(|id| id.starts_with(shared)).all(|id| stderr.contains(id.as_str())), "{stderr}");
    }
}

#[test]
fn text_that_begins_no_id_is_refused_in_one_line() {
    let served = TestDaemon::start();
    assert!(served.status(&["show", "last"], 2).1.contains(", found no jobs"));
    served.submit(&rest("only"), "max");
    for text in ["", "ffffff", "xyz", "../metrics", "LAST", "0123456789abcdef0123456789abcdef0"] {
        let (_, stderr) = served.status(&["cancel", text], 2);
        assert!(stderr.contains(&format!(", found {text:?}")) && stderr.lines().count() == 1, "{stderr}");
    }
}
