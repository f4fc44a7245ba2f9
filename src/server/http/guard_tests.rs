use std::sync::Arc;

use axum::Router;
use axum::body::Body;
use axum::extract::Request;
use axum::http::{HeaderName, HeaderValue, Version};
use axum::middleware::from_fn_with_state;
use tower::ServiceExt;

use super::origin_check::{AllowedHosts, guard};

async fn status(listen: &str, path: &str, headers: &[(&str, &str)]) -> u16 {
    let hosts = AllowedHosts::new(listen.parse().unwrap(), &["Rig.Example".to_owned(), "10.0.0.7".to_owned()]);
    let app = Router::new().fallback(|| async {}).layer(from_fn_with_state(Arc::new(hosts), guard));
    let mut request = Request::get(path).body(Body::empty()).unwrap();
    for (name, value) in headers {
        let name = HeaderName::from_bytes(name.as_bytes()).unwrap();
        request.headers_mut().append(name, HeaderValue::from_bytes(value.as_bytes()).unwrap());
    }
    *request.version_mut() = Version::HTTP_11;
    app.oneshot(request).await.unwrap().status().as_u16()
}

#[tokio::test]
async fn only_hosts_of_the_daemon_are_allowed() {
    let ours = "localhost|LocalHost:8750|localhost.:8750|127.0.0.1|[::1]:8750|[::ffff:127.0.0.1]:8750|rig.example|\
        RIG.example.:443";
    let others = "evil.example|localhost.evil.example|127.0.0.1.evil.example|127.0.0.2|2130706433|0x7f.1|127.1|\
        10.0.0.8|localhost..";
    let malformed = "|:8750|localhost:80a|localhost:123456|::1|[localhost]|[::1]x|user@localhost|localhost evil|\
        lo\u{441}alhost";
    for (hosts, wanted) in [(ours, 200), (others, 403), (malformed, 400)] {
        for host in hosts.split('|') {
            assert_eq!(status("127.0.0.1:8750", "/v1/jobs", &[("host", host)]).await, wanted, "{host:?}");
        }
    }
    assert_eq!(status("127.0.0.1:8750", "/", &[]).await, 400, "no Host, as HTTP/1.0 allows");
    let twice = [("host", "localhost"), ("host", "localhost")];
    assert_eq!(status("127.0.0.1:8750", "/", &twice).await, 400);
}

#[tokio::test]
async fn an_absolute_address_is_held_to_the_same() {
    let host = [("host", "localhost")];
    assert_eq!(status("127.0.0.1:8750", "http://localhost:8750/v1/jobs", &host).await, 200);
    assert_eq!(status("127.0.0.1:8750", "http://evil.example/v1/jobs", &host).await, 403);
    assert_eq!(status("127.0.0.1:8750", "http://localhost/v1/jobs", &[("host", "evil.example")]).await, 403);
}

#[tokio::test]
async fn any_ip_address_is_allowed_as_host_when_listening_on_all() {
    for (host, wanted) in [("192.168.3.4:8750", 200), ("[fe80::1]", 200), ("evil.example", 403), ("localhost", 200)] {
        assert_eq!(status("0.0.0.0:8750", "/", &[("host", host)]).await, wanted, "{host}");
        assert_eq!(status("[::]:8750", "/", &[("host", host)]).await, wanted, "{host}");
    }
    assert_eq!(status("192.168.3.4:8750", "/", &[("host", "192.168.3.4")]).await, 200);
    assert_eq!(status("192.168.3.4:8750", "/", &[("host", "192.168.3.5")]).await, 403);
}

#[tokio::test]
async fn only_origins_of_the_daemon_are_allowed() {
    let others = "https://rig.example|http://localhost:3000|http://127.0.0.1:8750|http://evil.example|null||\
        http://localhost:8750@evil.example|http://localhost:8750/|ftp://localhost:8750";
    for (origins, wanted) in [("http://localhost:8750|https://localhost:8750", 200), (others, 403)] {
        for origin in origins.split('|') {
            let headers = [("host", "localhost:8750"), ("origin", origin)];
            assert_eq!(status("127.0.0.1:8750", "/v1/jobs", &headers).await, wanted, "{origin:?}");
        }
    }
    let both = [("host", "localhost:8750"), ("origin", "http://localhost:8750"), ("origin", "http://evil.example")];
    assert_eq!(status("127.0.0.1:8750", "/v1/jobs", &both).await, 403);
    for (origin, wanted) in
        [("https://rig.example", 200), ("http://rig.example", 200), ("http://rig.example:9999", 403)]
    {
        let behind_a_proxy = [("host", "rig.example"), ("origin", origin)];
        assert_eq!(status("127.0.0.1:8750", "/v1/jobs", &behind_a_proxy).await, wanted, "{origin:?}");
    }
    let other_service = [("host", "rig.example:8750"), ("origin", "http://rig.example:9999")];
    assert_eq!(status("127.0.0.1:8750", "/v1/jobs", &other_service).await, 403);
    let default_port = [("host", "localhost"), ("origin", "http://localhost:80")];
    assert_eq!(status("127.0.0.1:80", "/v1/jobs", &default_port).await, 200);
}

#[tokio::test]
async fn other_sites_may_link_to_the_page_and_nothing_else() {
    let of = |site| [("host", "localhost:8750"), ("sec-fetch-site", site)];
    for (site, wanted) in [("same-origin", 200), ("none", 200), ("same-site", 403), ("cross-site", 403), ("", 403)] {
        assert_eq!(status("127.0.0.1:8750", "/v1/jobs", &of(site)).await, wanted, "{site:?}");
        assert_eq!(status("127.0.0.1:8750", "/", &of(site)).await, wanted, "{site:?}");
    }
    let link = |dest| {
        let host = ("host", "localhost:8750");
        [host, ("sec-fetch-site", "cross-site"), ("sec-fetch-mode", "navigate"), ("sec-fetch-dest", dest)]
    };
    assert_eq!(status("127.0.0.1:8750", "/", &link("document")).await, 200);
    assert_eq!(status("127.0.0.1:8750", "/", &link("iframe")).await, 403);
    assert_eq!(status("127.0.0.1:8750", "/v1/jobs", &link("document")).await, 403);
}
