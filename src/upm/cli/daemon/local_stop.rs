//! Emergency stops through the socket in a daemon's data folder, past the network.

use std::io::ErrorKind;
use std::net::IpAddr;
use std::path::{Path, PathBuf};

use serde_json::Value;
use ureq::http::Uri;

use super::client::url_of;
use crate::cli::client_args::EstopArgs;
use upm_runner::config::text_of;
use upm_server::api::EStopped;
use upm_server::daemon::{ESTOP_SOCKET, LocalStopRequest, stop_locally};

/// Data folder of the shipped unit.
const UNIT_DATA: &str = "/var/lib/upm";
/// Configuration file assumed if the daemon was started without one.
const USUAL_CONFIG: &str = "configs/daemon.json";

/// Stops the plates through the socket; `None` if no daemon there has one of them, in which case the caller uses HTTP.
pub(super) fn stop(args: &EstopArgs) -> Option<Vec<EStopped>> {
    let named = args.data.clone().or_else(|| Some(std::env::var_os("UPM_DATA")?.into()));
    let (folders, port) = match named {
        Some(folder) => (vec![folder], None),
        None => {
            let folders = vec![PathBuf::from(UNIT_DATA), data_of(Path::new(USUAL_CONFIG))];
            (folders, Some(port_on_loopback(&url_of(&args.daemon))?))
        }
    };
    let request = LocalStopRequest { plates: args.plates.clone(), port };
    folders.iter().find_map(|data| match stop_locally(data, &request) {
        Ok(answer) => {
            answer.error.iter().for_each(|error| tracing::debug!("{}: {error}", data.display()));
            (!answer.stops.is_empty()).then_some(answer.stops)
        }
        Err(error) => {
            // a missing socket is reported only where it was asked for
            let absent = [ErrorKind::NotFound, ErrorKind::PermissionDenied, ErrorKind::ConnectionRefused];
            if port.is_none() || !absent.contains(&error.kind()) {
                errln!("upm: {}: {error}; asking over HTTP", data.join(ESTOP_SOCKET).display());
            }
            None
        }
    })
}

/// Port of a daemon whose address is on this machine; distinguishes its socket from that of another daemon.
fn port_on_loopback(url: &str) -> Option<u16> {
    let uri = url.trim_end_matches('/').parse::<Uri>().ok()?;
    let host = uri.host()?.trim_matches(['[', ']']);
    let is_here = host == "localhost" || host.parse::<IpAddr>().is_ok_and(|address| address.is_loopback());
    is_here.then(|| uri.port_u16().unwrap_or(80))
}

/// Data folder named in a daemon file; the rest of the file is not read.
fn data_of(config: &Path) -> PathBuf {
    let value = text_of(config).ok().and_then(|text| serde_json::from_str::<Value>(&text).ok());
    let data = value.as_ref().and_then(|value| value.get("data")?.as_str()).unwrap_or("data");
    config.parent().unwrap_or(Path::new("")).join(data)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn port_for_the_socket_is_found_for_loopback_addresses_only() {
        let found = ["http://127.0.0.1:8750", "http://localhost/", "http://[::1]:9000", "http://127.0.0.9:1"]
            .map(port_on_loopback);
        assert_eq!(found, [Some(8750), Some(80), Some(9000), Some(1)]);
        assert_eq!(["http://192.0.2.1:8750", "http://lab.example", "nonsense"].map(port_on_loopback), [None; 3]);
    }

    #[test]
    fn data_folder_is_the_one_of_the_daemon_file_or_the_usual_one() {
        let folder = tempfile::tempdir().unwrap();
        let config = folder.path().join("daemon.json");
        assert_eq!(data_of(&config), folder.path().join("data"));
        std::fs::write(&config, r#"{"data": "/elsewhere"}"#).unwrap();
        assert_eq!(data_of(&config), Path::new("/elsewhere"));
    }
}
