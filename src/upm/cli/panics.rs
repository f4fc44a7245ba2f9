use std::backtrace::{Backtrace, BacktraceStatus};
use std::{panic, thread};

/// Installs a panic hook that logs a panic as one line, instead of writing to stderr, which could block on its reader.
pub(super) fn install_panic_hook() {
    panic::set_hook(Box::new(|panic| {
        let thread = thread::current();
        let name = thread.name().unwrap_or("unnamed");
        tracing::error!(thread = name, "{}", panic.to_string().replace('\n', " | "));
        let backtrace = Backtrace::capture();
        if backtrace.status() == BacktraceStatus::Captured {
            tracing::error!(thread = name, "that panic's backtrace:\n{backtrace}");
        }
    }));
}

#[cfg(test)]
mod tests {
    use std::panic::{catch_unwind, panic_any};

    use super::super::test_buffer::TestBuffer;
    use super::*;

    #[test]
    fn a_panic_is_one_line_of_the_log() {
        let page = TestBuffer::default();
        let writer = page.clone();
        let subscriber = tracing_subscriber::fmt().json().flatten_event(true).with_writer(move || writer.clone());
        let before = panic::take_hook();
        install_panic_hook();
        tracing::subscriber::with_default(subscriber.finish(), || {
            let (plate, two) = ("left", "two\nlines");
            assert!(catch_unwind(|| panic!("of {plate}: {two}")).is_err());
            assert!(catch_unwind(|| panic_any(7)).is_err());
        });
        panic::set_hook(before);
        let lines = page.lines().into_iter().map(|line| serde_json::from_str(&line).unwrap());
        let is_panic = |line: &serde_json::Value| line["message"].as_str().is_some_and(|it| it.starts_with("panicked"));
        let panics: Vec<serde_json::Value> = lines.filter(is_panic).collect();
        assert_eq!(panics.len(), 2, "{panics:?}");
        let message = panics[0]["message"].as_str().unwrap();
        assert!(message.contains("panics.rs:") && message.ends_with(" | of left: two | lines"), "{message}");
        assert!(panics.iter().all(|panic| panic["level"] == "ERROR" && panic["thread"].is_string()), "{panics:?}");
    }
}
