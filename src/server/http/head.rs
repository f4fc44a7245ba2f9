use std::io;

use bytes::{Bytes, BytesMut};
use tokio::net::TcpStream;

/// Bytes read at a time.
const READ: usize = 1 << 10;

/// Reads until the head of a request is complete, and returns all bytes read. An error when the head exceeds `most`
/// bytes, and when the client closes before its end.
pub(super) async fn read_head(stream: &TcpStream, most: usize) -> io::Result<Bytes> {
    let mut read = BytesMut::new();
    loop {
        stream.readable().await?;
        read.reserve(READ);
        let before = read.len();
        match stream.try_read_buf(&mut read) {
            Ok(0) => return Err(io::ErrorKind::UnexpectedEof.into()),
            Ok(_) if has_blank_line(read.get(before.saturating_sub(2)..).unwrap_or_default()) => {
                return Ok(read.freeze());
            }
            Ok(_) if read.len() > most => return Err(io::ErrorKind::InvalidData.into()),
            Ok(_) => {}
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => {}
            Err(error) => return Err(error),
        }
    }
}

/// True after the end of a head; lines end with or without a carriage return.
fn has_blank_line(bytes: &[u8]) -> bool {
    bytes.windows(3).any(|three| three == b"\n\r\n") || bytes.windows(2).any(|two| two == b"\n\n")
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
    async fn head_without_end_is_an_error() {
        assert_eq!(head_of(&[b"GET / HTTP/1.1\r\nHost: a\r\n"]).await, Err(io::ErrorKind::UnexpectedEof));
        assert_eq!(head_of(&[b""]).await, Err(io::ErrorKind::UnexpectedEof));
        assert_eq!(head_of(&[&[b'x'; 8192]]).await, Err(io::ErrorKind::InvalidData));
    }
}
