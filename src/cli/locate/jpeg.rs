//! Markers of JPEG files (ITU-T T.81, Annex B). The decoder fills what a truncated file lacks with gray and says nothing.

const END_OF_IMAGE: u8 = 0xD9;
const START_OF_SCAN: u8 = 0xDA;

/// True when the picture that `bytes` begin with goes on to its end. What comes after it does not matter.
pub(super) fn is_whole(bytes: &[u8]) -> bool {
    let mut rest = bytes.get(2..).unwrap_or_default();
    loop {
        let Some((marker, after)) = next_marker(rest) else { return false };
        match marker {
            END_OF_IMAGE => return true,
            // these stand alone
            0x01 | 0xD0..=0xD8 => {
                rest = after;
                continue;
            }
            _ => {}
        }
        let Some(&[high, low]) = after.first_chunk() else { return false };
        let Some(beyond) = after.get(usize::from(u16::from_be_bytes([high, low]))..) else { return false };
        rest = if marker == START_OF_SCAN { beyond_scan(beyond) } else { beyond };
    }
}

/// The next marker and what follows; any number of 0xFF may stand before it.
fn next_marker(bytes: &[u8]) -> Option<(u8, &[u8])> {
    let start = bytes.iter().position(|&byte| byte == 0xFF)?;
    let bytes = bytes.get(start..)?;
    let at = bytes.iter().position(|&byte| byte != 0xFF)?;
    Some((*bytes.get(at)?, bytes.get(at + 1..)?))
}

/// What follows a scan's data: in the data 0xFF is followed by zero, by a restart marker or by another 0xFF.
fn beyond_scan(data: &[u8]) -> &[u8] {
    let ends = |pair: &[u8]| matches!(*pair, [0xFF, after] if !matches!(after, 0x00 | 0xD0..=0xD7 | 0xFF));
    data.windows(2).position(ends).and_then(|end| data.get(end..)).unwrap_or_default()
}
