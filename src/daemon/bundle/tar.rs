//! A tar archive of small files (POSIX ustar), written by hand: blocks of 512 bytes, a header and the content of each
//! file, two blocks of zeros at the end.

use std::io;

use jiff::Timestamp;

const BLOCK: usize = 512;

/// Longest name of a file, bytes.
const LONGEST_NAME: usize = 100;

/// An archive as it grows.
#[derive(Debug)]
pub(super) struct Tar {
    bytes: Vec<u8>,
    made_at: Timestamp,
}

impl Tar {
    /// An empty archive; its files are all of the time `made_at`.
    pub fn new(made_at: Timestamp) -> Self {
        Self { bytes: Vec::new(), made_at }
    }

    /// Puts a file in. `Err` for a name that does not fit.
    pub fn add(&mut self, name: &str, content: &[u8]) -> io::Result<()> {
        if !(1..=LONGEST_NAME).contains(&name.len()) || !name.bytes().all(|byte| byte.is_ascii_graphic()) {
            let reason = format!("{name:?}: a file in an archive has 1 to {LONGEST_NAME} visible ASCII characters");
            return Err(io::Error::new(io::ErrorKind::InvalidInput, reason));
        }
        let header = header(name, content.len() as u64, self.made_at.as_second().max(0).unsigned_abs());
        self.bytes.extend(header);
        self.bytes.extend(content);
        self.pad();
        Ok(())
    }

    /// The whole archive.
    pub fn finish(mut self) -> Vec<u8> {
        self.bytes.extend([0; 2 * BLOCK]);
        self.bytes
    }

    fn pad(&mut self) {
        let length = self.bytes.len().next_multiple_of(BLOCK);
        self.bytes.resize(length, 0);
    }
}

/// Fields one after another; their widths are the standard's. The sum of all bytes is taken with the field of the sum
/// itself full of spaces.
fn header(name: &str, size: u64, at_s: u64) -> Vec<u8> {
    const SUM: std::ops::Range<usize> = 148..156;
    let mut header = Vec::with_capacity(BLOCK);
    text(&mut header, name, LONGEST_NAME);
    text(&mut header, "0000600", 8);
    text(&mut header, "0000000", 8);
    text(&mut header, "0000000", 8);
    text(&mut header, &format!("{size:011o}"), 12);
    text(&mut header, &format!("{at_s:011o}"), 12);
    header.extend([b' '; SUM.end - SUM.start]);
    header.push(b'0');
    text(&mut header, "", 100);
    header.extend(b"ustar\x0000");
    header.resize(BLOCK, 0);
    let sum: u32 = header.iter().map(|byte| u32::from(*byte)).sum();
    let written = format!("{sum:06o}\0 ");
    header.splice(SUM, written.into_bytes());
    header
}

/// `text`, then zeros up to `width` bytes.
fn text(header: &mut Vec<u8>, text: &str, width: usize) {
    let end = header.len() + width;
    header.extend(text.as_bytes());
    header.resize(end, 0);
}

/// Names and contents of the files in an archive, every header checked.
#[cfg(test)]
pub(super) fn read(bytes: &[u8]) -> Vec<(String, Vec<u8>)> {
    let octal = |field: &[u8]| {
        let digits = std::str::from_utf8(field).unwrap().trim_end_matches(['\0', ' ']);
        usize::from_str_radix(digits, 8).unwrap()
    };
    let (mut files, mut rest) = (Vec::new(), bytes);
    assert_eq!(bytes.len() % BLOCK, 0);
    while rest.iter().take(BLOCK).any(|byte| *byte != 0) {
        let (header, after) = rest.split_at(BLOCK);
        assert_eq!(&header[257..265], b"ustar\x0000");
        let sum: usize =
            header.iter().enumerate().map(|(i, b)| usize::from(if (148..156).contains(&i) { b' ' } else { *b })).sum();
        assert_eq!(octal(&header[148..156]), sum);
        let name = std::str::from_utf8(&header[..100]).unwrap().trim_end_matches('\0');
        let size = octal(&header[124..136]);
        files.push((name.to_owned(), after[..size].to_vec()));
        rest = &after[size.next_multiple_of(BLOCK)..];
    }
    assert_eq!(rest, [0; 2 * BLOCK]);
    files
}

#[cfg(test)]
mod tests {
    use std::process::Command;

    use super::*;

    fn archive(files: &[(String, Vec<u8>)]) -> Vec<u8> {
        let mut tar = Tar::new(Timestamp::from_second(1_800_000_000).unwrap());
        files.iter().for_each(|(name, content)| tar.add(name, content).unwrap());
        tar.finish()
    }

    fn files() -> Vec<(String, Vec<u8>)> {
        let sizes = [0, 1, 511, 512, 513, 100_000];
        let mut files: Vec<_> = sizes.map(|size| (format!("upm/{size}.bin"), vec![size as u8; size])).to_vec();
        files.push(("x".repeat(100), b"long".to_vec()));
        files
    }

    #[test]
    fn what_is_put_in_is_read_back() {
        assert_eq!(read(&archive(&files())), files());
        assert_eq!(read(&archive(&[])), []);
    }

    #[test]
    fn names_that_do_not_fit_are_refused() {
        let mut tar = Tar::new(Timestamp::UNIX_EPOCH);
        for name in ["", "a\nb", "ü", "a b", &"x".repeat(101)] {
            assert!(tar.add(name, b"").is_err(), "{name}");
        }
        assert_eq!(read(&tar.finish()), []);
    }

    /// Where there is a `tar`, it finds the same.
    #[test]
    fn tar_reads_it() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("a.tar"), archive(&files())).unwrap();
        let listed = Command::new("tar").args(["-tf", "a.tar"]).current_dir(folder.path()).output();
        let Ok(listed) = listed else { return };
        let names: Vec<String> = files().into_iter().map(|(name, _)| name).collect();
        assert_eq!(String::from_utf8(listed.stdout).unwrap().lines().collect::<Vec<_>>(), names);
        assert_eq!((listed.status.success(), listed.stderr.as_slice()), (true, &b""[..]));
        let made = Command::new("tar").args(["-xf", "a.tar"]).current_dir(folder.path()).status().unwrap();
        assert!(made.success());
        assert_eq!(std::fs::read(folder.path().join("upm/513.bin")).unwrap(), vec![1; 513]);
    }
}
