use std::io;

use bytes::{Bytes, BytesMut};
use tokio::net::TcpStream;

/// Bytes read at a time.
const READ: usize = 1 << 10;

/// Reads until the head of a request is complete, and returns all bytes read. Empty lines before a request are no head
/// (RFC 9112, section 2.2). An error when the head exceeds `most` bytes, and when the client closes before its end.
pub(super) async fn read_head(stream: &TcpStream, most: usize) -> io::Result<Bytes> {
    let mut read = BytesMut::new();
    loop {
        stream.readable().await?;
        read.reserve(READ);
        let before = read.len();
        match stream.try_read_buf(&mut read) {
            Ok(0) => return Err(io::ErrorKind::UnexpectedEof.into()),
            Ok(_) if has_head_end(&read, before) => return Ok(read.freeze()),
            Ok(_) if read.len() > most => return Err(io::ErrorKind::InvalidData.into()),
            Ok(_) => {}
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => {}
            Err(error) => return Err(error),
        }
    }
}

/// True if the head ends after its first `searched` bytes: with an empty line, after lines that end with or without a
/// carriage return.
fn has_head_end(read: &[u8], searched: usize) -> bool {
    let begin = read.iter().position(|byte| !b"\r\n".contains(byte)).unwrap_or(read.len());
    let new = read.get(begin.max(searched.saturating_sub(2))..).unwrap_or_default();
    new.windows(3).any(|three| three == b"\n\r\n") || new.windows(2).any(|two| two == b"\n\n")
}

#[cfg(test)]
mod tests {
    use tokio::io::AsyncWriteExt;
    use tokio::net::TcpListener;

    use super::*;

    /// The result for a client that sends these parts and then closes.
    async fn head_of(words: &[&[u8]]) -> Result<Bytes, io::ErrorKind> {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let mut client = TcpStream::connect(listener.local_addr().unwrap()).await.unwrap();
        client.set_nodelay(true).unwrap();
        let (server, _) = listener.accept().await.unwrap();
        let say = async {
            for word in words {
                client.write_all(word).await.unwrap();
                tokio::task::yield_now().await;
            }
            client.shutdown().await.unwrap();
        };
        tokio::join!(read_head(&server, 4096), say).0.map_err(|error| error.kind())
    }

    #[tokio::test]
    async fn head_is_read_to_its_end_however_it_comes() {
        let head = b"GET / HTTP/1.1\r\nHost: a\r\n\r\n";
        assert_eq!(head_of(&[head]).await, Ok(Bytes::from_static(head)));
        let single: Vec<&[u8]> = head.chunks(1).collect();
        assert_eq!(head_of(&single).await, Ok(Bytes::from_static(head)));
        assert_eq!(head_of(&[b"GET / HTTP/1.1\n", b"\n"]).await, Ok(Bytes::from_static(b"GET / HTTP/1.1\n\n")));
        assert!(head_of(&[head, b"body"]).await.unwrap().starts_with(head));
    }

    #[tokio::test]
    async fn empty_lines_before_a_request_are_no_head() {
        assert_eq!(head_of(&[b"\r\n\r\n"]).await, Err(io::ErrorKind::UnexpectedEof));
        assert_eq!(head_of(&[b"\n\n", b"GET / HTTP/1.1\r\n"]).await, Err(io::ErrorKind::UnexpectedEof));
        assert_eq!(head_of(&[&b"\r\n".repeat(4096)]).await, Err(io::ErrorKind::InvalidData));
        assert!(head_of(&[b"\r\n", b"\r\nGET / HTTP/1.1\r\n\r", b"\n"]).await.unwrap().ends_with(b"1\r\n\r\n"));
    }

    #[tokio::test]
    async fn head_without_end_is_an_error() {
        assert_eq!(head_of(&[b"GET / HTTP/1.1\r\nHost: a\r\n"]).await, Err(io::ErrorKind::UnexpectedEof));
        assert_eq!(head_of(&[b""]).await, Err(io::ErrorKind::UnexpectedEof));
        assert_eq!(head_of(&[&[b'x'; 8192]]).await, Err(io::ErrorKind::InvalidData));
    }
}
