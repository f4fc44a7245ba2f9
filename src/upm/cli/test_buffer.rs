use std::io::{self, Write};
use std::sync::{Arc, Mutex};

/// Buffer that collects the log in tests. Clones share it.
#[derive(Clone, Debug, Default)]
pub(super) struct TestBuffer(Arc<Mutex<Vec<u8>>>);

impl TestBuffer {
    pub(super) fn text(&self) -> String {
        String::from_utf8(self.0.lock().unwrap().clone()).unwrap()
    }

    pub(super) fn lines(&self) -> Vec<String> {
        self.text().lines().map(str::to_owned).collect()
    }
}

impl Write for TestBuffer {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.lock().unwrap().write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}
