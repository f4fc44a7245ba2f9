//! Tests of a live stream with viewers and runs. The viewers here speak just enough HTTP/2 to request it.

use std::io::{self, Read, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpListener, TcpStream};
use std::path::Path;
use std::thread;
use std::time::Duration;

use super::tests::{context, recording_options, stores};
use super::{LiveServer, RerunSink};
use crate::RecordingError;
use upm_core::background::OverflowPolicy;
use upm_core::time::{Clock, MonotonicClock};
use upm_fixtures::synthetic_run::SyntheticRun;
use upm_recording::{RecordingOptions, RecordingState, RerunMode};

const HISTORY_BYTES: u64 = 16 << 20;
/// Largest window of HTTP/2, bytes.
const WIDEST: u32 = 0x7fff_ffff;

fn address(server: &LiveServer) -> SocketAddr {
    let address = server.uri().strip_prefix("rerun+http://").unwrap();
    address.strip_suffix("/proxy").unwrap().parse().unwrap()
}

fn record(server: &LiveServer, path: &Path) -> Result<bool, RecordingError> {
    let mut run = SyntheticRun::new(2);
    let mut sink = RerunSink::start(&RerunMode::Save, path, Some(server), context(&run), &recording_options()).unwrap();
    run.localise(&mut sink);
    for _ in 0..4 {
        run.cycle(&mut sink);
    }
    sink.finish()
}

/// A connection that has requested everything the server has and reads it.
fn viewer(server: &LiveServer) -> TcpStream {
    // with the largest windows, as otherwise the stream would end after 64 KiB
    let mut stream = frozen_viewer(server);
    stream.write_all(&frame(4, 0, 0, &[&[0, 4][..], &WIDEST.to_be_bytes()].concat())).unwrap();
    stream.write_all(&frame(8, 0, 0, &(WIDEST - 65_535).to_be_bytes())).unwrap();
    stream
}

fn frame(kind: u8, flags: u8, stream: u8, payload: &[u8]) -> Vec<u8> {
    let length = u32::try_from(payload.len()).unwrap().to_be_bytes();
    [&length[1..], &[kind, flags, 0, 0, 0, stream], payload].concat()
}

/// A connection that has requested everything and reads at most 64 KiB of it.
fn frozen_viewer(server: &LiveServer) -> TcpStream {
    let names = [
        (":method", "POST"),
        (":scheme", "http"),
        (":path", "/rerun.sdk_comms.v1alpha1.MessageProxyService/ReadMessages"),
        (":authority", "127.0.0.1"),
        ("content-type", "application/grpc"),
        ("te", "trailers"),
    ];
    // each as a literal without an index
    let header = |(name, value): (&str, &str)| {
        let lengths = [name, value].map(|text| u8::try_from(text.len()).unwrap());
        [&[0, lengths[0]], name.as_bytes(), &[lengths[1]], value.as_bytes()].concat()
    };
    let headers: Vec<u8> = names.into_iter().flat_map(header).collect();
    let mut stream = TcpStream::connect(address(server)).unwrap();
    stream.write_all(b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n").unwrap();
    stream.write_all(&frame(4, 0, 0, &[])).unwrap();
    stream.write_all(&frame(1, 4, 1, &headers)).unwrap();
    stream.write_all(&frame(0, 1, 1, &[0; 5])).unwrap();
    stream
}

/// True once `stream` has delivered `text`.
fn brings(stream: &mut TcpStream, text: &str) -> bool {
    stream.set_read_timeout(Some(Duration::from_secs(10))).unwrap();
    let mut seen = Vec::new();
    loop {
        let searched = seen.len().saturating_sub(text.len());
        let Ok(more) = payload(stream) else { return false };
        seen.extend(more);
        if has(&seen[searched..], text) {
            return true;
        }
    }
}

/// Data in the next frame, possibly empty.
fn payload(stream: &mut TcpStream) -> io::Result<Vec<u8>> {
    let mut head = [0; 9];
    stream.read_exact(&mut head)?;
    let [high, middle, low, kind, ..] = head;
    let mut payload = vec![0; u32::from_be_bytes([0, high, middle, low]) as usize];
    stream.read_exact(&mut payload)?;
    Ok(if kind == 0 { payload } else { Vec::new() })
}

fn has(bytes: &[u8], text: &str) -> bool {
    bytes.windows(text.len()).any(|window| window == text.as_bytes())
}

/// Name of the recording in the file at `path`; each run has a new one.
fn recording_id(path: &Path) -> String {
    stores(path).0.id
}

#[test]
fn viewers_see_every_run_apart_whether_they_come_early_or_late() {
    let folder = tempfile::tempdir().unwrap();
    let [first, second] = ["1.rrd", "2.rrd"].map(|name| folder.path().join(name));
    let server = LiveServer::start(None, HISTORY_BYTES).unwrap();
    let mut early = viewer(&server);
    for path in [&first, &second] {
        assert!(!record(&server, path).unwrap(), "nobody waits for viewers");
    }
    let ids = [&first, &second].map(|path| recording_id(path));
    assert_ne!(ids[0], ids[1]);
    assert!(brings(&mut early, &ids[0]) && brings(&mut early, &ids[1]));
    assert!(brings(&mut viewer(&server), &ids[0]) && brings(&mut viewer(&server), &ids[1]));
    assert_eq!(server.lost(), 0);
}

#[test]
fn a_run_without_a_file_is_seen_all_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let server = LiveServer::start(None, HISTORY_BYTES).unwrap();
    let mut run = SyntheticRun::new(2);
    let recording_options = RecordingOptions { recording_overflow: OverflowPolicy::GiveUp, ..recording_options() };
    let path = folder.path().join("run.rrd");
    let mut sink = RerunSink::start(&RerunMode::Off, &path, Some(&server), context(&run), &recording_options).unwrap();
    run.cycle(&mut sink);
    run.cycle(&mut sink);
    assert!(!sink.finish().unwrap());
    assert_eq!(
        (recording_options.recording.state(), recording_options.recording.take_end()),
        (RecordingState::Off, None)
    );
    assert_eq!(folder.path().read_dir().unwrap().count(), 0);
    assert!(brings(&mut viewer(&server), "upm"));
}

#[test]
fn live_server_listens_on_loopback_only() {
    let server = LiveServer::start(None, HISTORY_BYTES).unwrap();
    let port = address(&server).port();
    assert!(address(&server).ip() == Ipv4Addr::LOCALHOST && TcpStream::connect(address(&server)).is_ok());
    let elsewhere = TcpStream::connect((Ipv4Addr::new(127, 0, 0, 2), port));
    assert_eq!(elsewhere.unwrap_err().kind(), io::ErrorKind::ConnectionRefused);
}

#[test]
fn port_in_use_is_reported_at_once() {
    let other = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
    let port = other.local_addr().unwrap().port();
    assert_eq!(LiveServer::start(Some(port), HISTORY_BYTES).unwrap_err().kind(), io::ErrorKind::AddrInUse);
    drop(other);
    let server = LiveServer::start(Some(port), HISTORY_BYTES).unwrap();
    assert_eq!(server.uri(), format!("rerun+http://127.0.0.1:{port}/proxy"));
}

#[test]
fn a_viewer_that_never_reads_costs_a_run_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.rrd");
    let server = LiveServer::start(None, HISTORY_BYTES).unwrap();
    let _frozen = frozen_viewer(&server);
    thread::sleep(Duration::from_millis(100));
    let clock = MonotonicClock::new();
    let mut run = SyntheticRun::new(8);
    let mut sink =
        RerunSink::start(&RerunMode::Save, &path, Some(&server), context(&run), &recording_options()).unwrap();
    let mut worst = Duration::ZERO;
    while server.lost() == 0 && clock.elapsed() < Duration::from_secs(60) {
        let before = clock.elapsed();
        run.cycle(&mut sink);
        worst = worst.max(clock.elapsed() - before);
    }
    assert!(server.lost() > 0, "it took everything");
    assert!(worst < Duration::from_secs(2), "{worst:?}");
    let before = clock.elapsed();
    sink.finish().unwrap();
    drop(server);
    assert!(clock.elapsed() - before < Duration::from_secs(2), "the end waited");
    stores(&path);
}
