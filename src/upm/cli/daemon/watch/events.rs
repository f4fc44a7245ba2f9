use std::io::{self, BufRead, BufReader, Read};

use serde_json::Value;

/// Longest line of a stream that is read, bytes. The longest that a daemon sends is a line of a journal.
const LONGEST_LINE: u64 = 16 << 20;

/// Server-sent event.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct ReceivedEvent {
    /// Offset in the journal from which the stream can be resumed.
    pub id: Option<u64>,
    /// Name of the event; `message` for a line of the journal.
    pub kind: String,
    /// Payload; null if it is not JSON.
    pub data: Value,
}

/// Parser of server-sent events.
pub(super) struct EventReader<R> {
    lines: BufReader<R>,
}

impl<R: Read> EventReader<R> {
    pub fn new(stream: R) -> Self {
        Self { lines: BufReader::new(stream) }
    }

    /// The next event; `None` at the end of the stream. An event cut short by the end is dropped.
    pub fn next(&mut self) -> io::Result<Option<ReceivedEvent>> {
        let (mut id, mut kind, mut data) = (None, "message".to_owned(), String::new());
        while let Some(line) = self.line()? {
            let (field, value) = line.split_once(':').unwrap_or((&line, ""));
            let value = value.strip_prefix(' ').unwrap_or(value);
            match field {
                "id" => id = value.parse().ok(),
                "event" => value.clone_into(&mut kind),
                "data" => data = if data.is_empty() { value.to_owned() } else { format!("{data}\n{value}") },
                "" if line.is_empty() && !data.is_empty() => {
                    let data = serde_json::from_str(&data).unwrap_or(Value::Null);
                    return Ok(Some(ReceivedEvent { id, kind, data }));
                }
                _ => {}
            }
        }
        Ok(None)
    }

    /// The next complete line, without its terminator.
    fn line(&mut self) -> io::Result<Option<String>> {
        let mut bytes = Vec::new();
        self.lines.by_ref().take(LONGEST_LINE).read_until(b'\n', &mut bytes)?;
        if bytes.pop() != Some(b'\n') {
            let too_long = || io::Error::new(io::ErrorKind::InvalidData, "a line without end");
            return if bytes.len() as u64 + 1 >= LONGEST_LINE { Err(too_long()) } else { Ok(None) };
        }
        if bytes.last() == Some(&b'\r') {
            bytes.pop();
        }
        Ok(Some(String::from_utf8_lossy(&bytes).into_owned()))
    }
}
