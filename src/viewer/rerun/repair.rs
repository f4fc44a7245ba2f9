//! Repair of the recording that a killed process left.

use std::fs::{self, File, OpenOptions};
use std::io::{self, BufReader, ErrorKind, Read, Seek};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

use rerun::external::re_build_info::CrateVersion;
use rerun::external::re_log_encoding::{
    CachingApplicationIdInjector, Decodable, DecoderTransport, Encoder, EncodingOptions, MessageHeader, MessageKind,
    StreamFooter, StreamHeader, ToApplication,
};
use rerun::log::LogMsg;

use super::partial_file::{PartialFile, keep, lock, open_regular};
use crate::types::RecordingError;
use upm_core::job::RecordingRepair;

/// Largest length of a message in a recording, packed or unpacked, bytes. A message with a larger length is broken.
const LONGEST_BYTES: u64 = 64 << 20;

/// Makes a complete recording `out` from `part`, which may end anywhere: every message up to the first broken one, and
/// the footer. A complete `part` is only renamed; in any case it is gone afterwards. Safe to repeat after an
/// interruption. Refuses a `part` that is still being written, that is not a regular file, or that is not a recording.
pub fn repair_recording(part: &Path, out: &Path) -> Result<RecordingRepair, RecordingError> {
    repair(part, out).map_err(|reason| RecordingError::Repair { path: part.to_owned(), reason })
}

fn repair(part: &Path, out: &Path) -> Result<RecordingRepair, String> {
    let file = open_regular(part, OpenOptions::new().read(true)).map_err(message_of)?;
    lock(&file).map_err(message_of)?;
    let mut frames = Frames::new(file)?;
    if let Some(messages) = frames.whole().map_err(message_of)? {
        keep(part, out).map_err(message_of)?;
        return Ok(RecordingRepair { messages, cut_bytes: 0, was_whole: true });
    }
    frames.rewind().map_err(message_of)?;
    let (partial_file, copy) = PartialFile::create_as("repair", out).map_err(message_of)?;
    let messages = frames.copy_into(copy).inspect_err(|_| {
        fs::remove_file(partial_file.part()).ok(); // a full disk needs the room
    })?;
    // moved to the place of the broken one first, so that two of them never exist side by side
    keep(partial_file.part(), part).and_then(|()| keep(part, out)).map_err(message_of)?;
    Ok(RecordingRepair { messages, cut_bytes: frames.size - frames.at, was_whole: false })
}

fn message_of(fault: impl std::fmt::Display) -> String {
    fault.to_string()
}

/// A recording as a sequence of framed messages, one of them in memory at a time. A frame is accepted only when it ends
/// within the file: Rerun's decoder would allocate any length it reads.
struct Frames {
    file: BufReader<File>,
    size: u64,
    /// Offset of the next frame, bytes.
    at: u64,
    /// Header of the file.
    head: Vec<u8>,
    /// The last frame read, its header included.
    frame: Vec<u8>,
}

const HEADER_BYTES: usize = MessageHeader::ENCODED_SIZE_BYTES;
const FOOTER_BYTES: usize = StreamFooter::ENCODED_SIZE_BYTES;

impl Frames {
    fn new(file: File) -> Result<Self, String> {
        let size = file.metadata().map_err(message_of)?.len();
        let mut frames = Self { file: BufReader::new(file), size, at: 0, head: Vec::new(), frame: Vec::new() };
        frames.rewind().map_err(message_of)?;
        Ok(frames)
    }

    /// Seeks to the first message. A file too short for the header has none; one that is not a recording is an error.
    fn rewind(&mut self) -> io::Result<()> {
        self.file.rewind()?;
        self.at = 0;
        self.frame.clear();
        if self.read(StreamHeader::ENCODED_SIZE_BYTES as u64)? {
            let header = StreamHeader::from_rrd_bytes(&self.frame).and_then(StreamHeader::to_version_and_options);
            header.map_err(|fault| io::Error::new(ErrorKind::InvalidData, fault.to_string()))?;
        }
        self.head.clone_from(&self.frame);
        Ok(())
    }

    /// Appends `bytes` bytes to the frame; false when the file is too short.
    fn read(&mut self, bytes: u64) -> io::Result<bool> {
        if bytes > LONGEST_BYTES || self.at.checked_add(bytes).is_none_or(|end| end > self.size) {
            return Ok(false);
        }
        let read = (&mut self.file).take(bytes).read_to_end(&mut self.frame)? as u64;
        self.at += read;
        Ok(read == bytes)
    }

    /// Reads the next frame into memory and returns its kind; `None` when it is broken or the file ends.
    fn next(&mut self) -> io::Result<Option<MessageKind>> {
        self.frame.clear();
        if !self.read(HEADER_BYTES as u64)? {
            return Ok(None);
        }
        let Ok(MessageHeader { kind, len }) = MessageHeader::from_rrd_bytes(&self.frame) else { return Ok(None) };
        Ok(self.read(len)?.then_some(kind))
    }

    /// The number of messages in a recording that was closed properly, whose footer is valid and ends with the file.
    fn whole(&mut self) -> io::Result<Option<u64>> {
        let mut messages = 0;
        loop {
            match self.next()? {
                Some(MessageKind::End) => break,
                Some(_) => messages += 1,
                None => return Ok(None),
            }
        }
        let manifest = self.frame.split_off(HEADER_BYTES);
        let manifest_at = self.at - manifest.len() as u64;
        self.frame.clear();
        if self.at + FOOTER_BYTES as u64 != self.size || !self.read(FOOTER_BYTES as u64)? {
            return Ok(None);
        }
        let footer = StreamFooter::from_rrd_footer_bytes(manifest_at, &manifest);
        let is_its_footer =
            has_one_entry(&self.frame) && StreamFooter::from_rrd_bytes(&self.frame).is_ok_and(|found| found == footer);
        Ok(is_its_footer.then_some(messages))
    }

    /// Copies every message up to the first broken one into a new recording and closes it. Afterwards the position is
    /// after the last message copied. Returns the number of messages.
    fn copy_into(&mut self, out: File) -> Result<u64, String> {
        let mut encoder =
            Encoder::new_eager(CrateVersion::LOCAL, EncodingOptions::PROTOBUF_COMPRESSED, out).map_err(message_of)?;
        let mut unpacker = Unpacker::new(self.head.clone());
        let (mut messages, mut copied_to) = (0, self.at);
        while let Some(kind) = self.next().map_err(message_of)? {
            let message = if kind == MessageKind::End { None } else { unpacker.unpack(&self.frame) };
            let Some(message) = message else { break };
            encoder.append(&message).map_err(message_of)?;
            messages += 1;
            copied_to = self.at;
        }
        self.at = copied_to;
        encoder.finish().and_then(|()| encoder.into_inner()).map_err(message_of)?;
        Ok(messages)
    }
}

/// Rerun's footer reader assumes it.
fn has_one_entry(footer: &[u8]) -> bool {
    footer.ends_with(&1_u32.to_le_bytes())
}

/// Decodes frames into messages.
struct Unpacker {
    decoder: DecoderTransport,
    apps: CachingApplicationIdInjector,
}

impl Unpacker {
    /// An unpacker for a recording that begins with `head`.
    fn new(head: Vec<u8>) -> Self {
        let mut decoder = DecoderTransport::new();
        decoder.push_byte_chunk(head);
        Self { decoder, apps: CachingApplicationIdInjector::default() }
    }

    /// The message in `frame`; `None` when it is broken, in which case no message after it is valid.
    fn unpack(&mut self, frame: &[u8]) -> Option<LogMsg> {
        // the decoders underneath are third-party code: if one panics on broken bytes, the frame counts as broken
        let unpacked = catch_unwind(AssertUnwindSafe(|| {
            self.decoder.push_byte_chunk(frame.to_vec());
            let message = self.decoder.try_read().ok()??;
            if message.byte_size_uncompressed() > LONGEST_BYTES {
                return None;
            }
            message.to_application((&mut self.apps, None)).ok()
        }));
        unpacked.ok().flatten()
    }
}
