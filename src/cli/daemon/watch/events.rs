use std::io::{self, BufRead, BufReader, Read};

use serde_json::Value;

/// Longest line of a stream, bytes. The longest a daemon sends is a snapshot with a report.
const LONGEST_LINE: u64 = 8 << 20;

/// A server-sent event.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Event {
    /// Its number, where it is kept.
    pub id: Option<u64>,
    /// One word.
    pub kind: String,
    /// Payload; null where it is no JSON.
    pub data: Value,
}

/// Server-sent events out of the bytes they came as.
pub(super) struct Events<R> {
    lines: BufReader<R>,
}

impl<R: Read> Events<R> {
    pub fn new(stream: R) -> Self {
        Self { lines: BufReader::new(stream) }
    }

    /// The next event; `None` at the end of the stream. One that the end cut short is none.
    pub fn next(&mut self) -> io::Result<Option<Event>> {
        let (mut id, mut kind, mut data) = (None, String::new(), String::new());
        while let Some(line) = self.line()? {
            let (field, value) = line.split_once(':').unwrap_or((&line, ""));
            let value = value.strip_prefix(' ').unwrap_or(value);
            match field {
                "id" => id = value.parse().ok(),
                "event" => value.clone_into(&mut kind),
                "data" => data = if data.is_empty() { value.to_owned() } else { format!("{data}\n{value}") },
                "" if line.is_empty() && !data.is_empty() => {
                    let data = serde_json::from_str(&data).unwrap_or(Value::Null);
                    return Ok(Some(Event { id, kind, data }));
                }
                _ => {}
            }
        }
        Ok(None)
    }

    /// The next line that is whole, without its end.
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
