use super::*;
use proptest::prelude::*;

const TOKEN: &str = "a-token-for-tests-0123";
const KEY: &str = "a-session-key-012345";

fn closed() -> Guard {
    let session = Token::chosen(KEY).unwrap();
    Guard::new(Some(Token::chosen(TOKEN).unwrap()), session, "tank-pc\n")
}

fn loopback() -> Guard {
    Guard::new(None, Token::chosen(KEY).unwrap(), "tank-pc")
}

fn get<'a>(path: &'a str, query: &'a str) -> Asked<'a> {
    Asked {
        method: "GET",
        path,
        query,
        authority: None,
        host: Header::Once("127.0.0.1:8080"),
        origin: Header::Absent,
        fetch_site: Header::Absent,
        fetch_mode: Header::Absent,
        authorization: Header::Absent,
        session: Header::Absent,
        has_body: false,
    }
}

fn stop() -> Asked<'static> {
    Asked {
        method: "POST",
        origin: Header::Once("http://127.0.0.1:8080"),
        fetch_site: Header::Once("same-origin"),
        session: Header::Once(KEY),
        ..get("/stop", "")
    }
}

#[test]
fn the_page_and_what_it_asks_for_are_answered() {
    let guard = loopback();
    let ask = |path, query| guard.check(&get(path, query));
    assert_eq!(ask("/", ""), Ok(Route::Page));
    assert_eq!(ask("/state", "after=7"), Ok(Route::State { after: 7 }));
    assert_eq!(
        ask("/picture", "x=1&after=9"),
        Ok(Route::Picture { after: 9 })
    );
    assert_eq!(ask("/state", "after=-1"), Ok(Route::State { after: 0 }));
    assert_eq!(ask("/metrics", ""), Ok(Route::Metrics));
    assert_eq!(guard.check(&stop()), Ok(Route::Stop));
}

#[test]
fn only_get_and_one_post() {
    for guard in [loopback(), closed()] {
        for method in [
            "HEAD", "OPTIONS", "PUT", "DELETE", "TRACE", "PATCH", "CONNECT", "get", "PRI", "",
        ] {
            for path in ["/", "/state", "/stop", "/x"] {
                let query = format!("token={TOKEN}");
                let asked = Asked {
                    method,
                    ..get(path, &query)
                };
                assert_eq!(guard.check(&asked), Err(Refusal::Method), "{method} {path}");
            }
        }
        let query = format!("token={TOKEN}");
        let asked = Asked {
            method: "POST",
            ..get("/state", &query)
        };
        assert_eq!(guard.check(&asked), Err(Refusal::Method));
        assert_eq!(guard.check(&get("/stop", &query)), Err(Refusal::Method));
        assert_eq!(
            guard.check(&get("/../etc/passwd", &query)),
            Err(Refusal::Unknown)
        );
    }
}

#[test]
fn a_rebound_name_is_not_this_computer() {
    let named = |guard: &Guard, host| {
        let query = format!("token={TOKEN}");
        guard.check(&Asked {
            host,
            ..get("/state", &query)
        })
    };
    let state = Ok(Route::State { after: 0 });
    for host in [
        "127.0.0.1",
        "localhost:9000",
        "LOCALHOST",
        "[::1]:8080",
        "127.0.0.9:1",
    ] {
        assert_eq!(named(&loopback(), Header::Once(host)), state, "{host}");
        assert_eq!(named(&closed(), Header::Once(host)), state, "{host}");
    }
    for host in [
        "192.168.1.7:8080",
        "tank-pc:8080",
        "tank-pc.local",
        "[fe80::1]:8080",
    ] {
        assert_eq!(
            named(&loopback(), Header::Once(host)),
            Err(Refusal::Host),
            "{host}"
        );
        assert_eq!(named(&closed(), Header::Once(host)), state, "{host}");
    }
    for host in [
        "evil.example",
        "localhost.evil.example:8080",
        "127.0.0.1.nip.io",
        "127.0.0.1:80@evil",
        "",
        "[::1",
        "[::1]x",
        "2130706433",
    ] {
        assert_eq!(
            named(&loopback(), Header::Once(host)),
            Err(Refusal::Host),
            "{host}"
        );
        assert_eq!(
            named(&closed(), Header::Once(host)),
            Err(Refusal::Host),
            "{host}"
        );
    }
    for host in [Header::Absent, Header::Unclear] {
        assert_eq!(named(&loopback(), host), Err(Refusal::Host));
    }
}

#[test]
fn a_target_that_names_another_computer_is_refused_as_its_host_would_be() {
    for authority in [
        "evil.example",
        "evil.example:8080",
        "127.0.0.1@evil.example",
        "evil@127.0.0.1:8080",
        "127.0.0.1.nip.io:8080",
        "",
    ] {
        let query = format!("token={TOKEN}");
        let asked = Asked {
            authority: Some(authority),
            ..get("/state", &query)
        };
        for guard in [loopback(), closed()] {
            assert_eq!(guard.check(&asked), Err(Refusal::Host), "{authority}");
        }
        let asked = Asked {
            authority: Some(authority),
            ..stop()
        };
        assert_eq!(loopback().check(&asked), Err(Refusal::Host), "{authority}");
    }
    let own = Asked {
        authority: Some("127.0.0.1:8080"),
        ..stop()
    };
    assert_eq!(loopback().check(&own), Ok(Route::Stop));
    // One of the two alone is not enough.
    let rebound = Asked {
        host: Header::Once("evil.example"),
        ..own
    };
    assert_eq!(loopback().check(&rebound), Err(Refusal::Host));
}

#[test]
fn without_the_token_nothing_is_sent() {
    let guard = closed();
    for path in ["/", "/state", "/picture", "/metrics", "/stop", "/nothing"] {
        for query in [
            "",
            "token=",
            "token=a-token-for-tests-012",
            "token=A-TOKEN-FOR-TESTS-0123",
            "TOKEN=a-token-for-tests-0123",
        ] {
            for method in ["GET", "POST", "HEAD"] {
                let asked = Asked {
                    method,
                    ..get(path, query)
                };
                assert_eq!(
                    guard.check(&asked),
                    Err(Refusal::Token),
                    "{method} {path}?{query}"
                );
            }
        }
    }
    let with = |authorization| {
        guard.check(&Asked {
            authorization,
            ..get("/metrics", "")
        })
    };
    assert_eq!(
        with(Header::Once("Bearer a-token-for-tests-0123")),
        Ok(Route::Metrics)
    );
    assert_eq!(
        with(Header::Once("Basic a-token-for-tests-0123")),
        Err(Refusal::Token)
    );
    assert_eq!(with(Header::Unclear), Err(Refusal::Token));
    // The token opens the page; STOP wants the session's key all the same.
    let query = format!("token={TOKEN}");
    let asked = Asked {
        query: &query,
        session: Header::Absent,
        ..stop()
    };
    assert_eq!(guard.check(&asked), Err(Refusal::Session));
}

#[test]
fn another_site_can_neither_read_nor_stop() {
    let guard = loopback();
    let cases: [(&str, Asked<'_>); 8] = [
        (
            "a form",
            Asked {
                origin: Header::Once("http://evil.example"),
                fetch_site: Header::Once("cross-site"),
                session: Header::Absent,
                ..stop()
            },
        ),
        (
            "a form of an old browser",
            Asked {
                origin: Header::Once("null"),
                fetch_site: Header::Absent,
                ..stop()
            },
        ),
        (
            "a server on another port",
            Asked {
                origin: Header::Once("http://127.0.0.1:3000"),
                ..stop()
            },
        ),
        (
            "the same by https",
            Asked {
                origin: Header::Once("https://127.0.0.1:8080"),
                ..stop()
            },
        ),
        (
            "an image",
            Asked {
                fetch_site: Header::Once("cross-site"),
                fetch_mode: Header::Once("no-cors"),
                ..get("/picture", "")
            },
        ),
        (
            "a sibling",
            Asked {
                fetch_site: Header::Once("same-site"),
                ..get("/state", "")
            },
        ),
        (
            "a fetch of the page",
            Asked {
                fetch_site: Header::Once("cross-site"),
                fetch_mode: Header::Once("cors"),
                ..get("/", "")
            },
        ),
        (
            "two origins",
            Asked {
                origin: Header::Unclear,
                ..stop()
            },
        ),
    ];
    for (what, asked) in cases {
        assert_eq!(guard.check(&asked), Err(Refusal::OtherSite), "{what}");
    }
    // A link to the page in a message is somebody opening it; what it shows stays unreadable to the message.
    let link = Asked {
        fetch_site: Header::Once("cross-site"),
        fetch_mode: Header::Once("navigate"),
        ..get("/", "")
    };
    assert_eq!(guard.check(&link), Ok(Route::Page));
    let body = Asked {
        has_body: true,
        ..stop()
    };
    assert_eq!(guard.check(&body), Err(Refusal::Body));
    let key = Asked {
        session: Header::Once("a-session-key-012346"),
        ..stop()
    };
    assert_eq!(guard.check(&key), Err(Refusal::Session));
}

fn header() -> impl Strategy<Value = Option<String>> {
    proptest::option::of(prop_oneof![
        ".*",
        Just("127.0.0.1:8080".to_owned()),
        Just("http://127.0.0.1:8080".to_owned()),
        Just("same-origin".to_owned()),
        Just(format!("Bearer {TOKEN}")),
        Just(KEY.to_owned()),
        Just("[".to_owned()),
    ])
}

fn of(text: &Option<String>) -> Header<'_> {
    text.as_deref().map_or(Header::Absent, Header::Once)
}

proptest! {
    #[test]
    fn whatever_is_sent_only_the_key_stops_and_only_the_token_opens(
        method in prop_oneof![Just("GET".to_owned()), Just("POST".to_owned()), ".*"],
        path in prop_oneof![Just("/".to_owned()), Just("/stop".to_owned()), Just("/state".to_owned()), ".*"],
        query in prop_oneof![Just(String::new()), Just(format!("token={TOKEN}")), ".*"],
        authority in header(), host in header(), origin in header(), site in header(), mode in header(),
        authorization in header(), session in header(),
    ) {
        let asked = Asked {
            method: &method, path: &path, query: &query, authority: authority.as_deref(),
            host: of(&host), origin: of(&origin), fetch_site: of(&site), fetch_mode: of(&mode),
            authorization: of(&authorization), session: of(&session), has_body: false,
        };
        for (guard, has_token) in [(loopback(), false), (closed(), true)] {
            if let Ok(route) = guard.check(&asked) {
                prop_assert!(host.is_some());
                prop_assert_eq!(route == Route::Stop, method == "POST");
                prop_assert!(route != Route::Stop || session.as_deref() == Some(KEY));
                let named = authority.as_deref().or(host.as_deref()).unwrap();
                prop_assert!(origin.as_ref().is_none_or(|o| o.ends_with(named)));
                let shown = authorization.iter().any(|a| a.contains(TOKEN)) || query.contains(TOKEN);
                prop_assert!(!has_token || shown);
            }
        }
    }
}

/// Request of a browser when a script of a site opens a WebSocket.
fn viewer(origin: &'static str, query: &'static str) -> Asked<'static> {
    Asked {
        origin: Header::Once(origin),
        fetch_site: Header::Once("cross-site"),
        fetch_mode: Header::Once("websocket"),
        ..get("/foxglove", query)
    }
}

#[test]
fn a_foxglove_viewer_is_a_known_one_or_has_the_token() {
    let look = Ok(Route::Foxglove);
    assert_eq!(loopback().check(&get("/foxglove", "")), look, "no browser");
    assert_eq!(
        loopback().check(&viewer("https://app.foxglove.dev", "")),
        look
    );
    for other in [
        "file://",
        "https://evil.example",
        "https://app.foxglove.dev.evil.example",
        "http://app.foxglove.dev",
        "null",
        "",
    ] {
        assert_eq!(
            loopback().check(&viewer(other, "")),
            Err(Refusal::OtherSite),
            "{other}"
        );
        let with = viewer(other, "token=a-token-for-tests-0123");
        assert_eq!(closed().check(&with), look, "{other} with the token");
        assert_eq!(
            closed().check(&viewer(other, "token=another-token-0123456")),
            Err(Refusal::Token)
        );
    }
    // A viewer looks; nothing else opens to its site.
    for path in ["/", "/state", "/picture", "/foxglove-layout.json", "/stop"] {
        let asked = Asked {
            path,
            ..viewer("https://app.foxglove.dev", "")
        };
        let answer = loopback().check(&asked);
        assert!(answer.is_err(), "{path}: {answer:?}");
    }
}

/// A page that only shows has the same guard: whoever may not see the live page sees no log either.
#[test]
fn what_only_shows_is_looked_at_by_the_same_rules() {
    let guard = loopback();
    let look = |asked: Asked<'_>| guard.look(&asked);
    for (path, query) in [("/", ""), ("/frame", "log=0&t=1"), ("/anything", "")] {
        assert_eq!(look(get(path, query)), Ok(()), "{path}");
        let asked = |host| Asked {
            host: Header::Once(host),
            ..get(path, query)
        };
        assert_eq!(look(asked("evil.example")), Err(Refusal::Host));
        let other = Asked {
            origin: Header::Once("http://evil.example"),
            ..get(path, query)
        };
        assert_eq!(look(other), Err(Refusal::OtherSite));
        for method in ["POST", "HEAD", "DELETE", "get"] {
            let asked = Asked {
                method,
                ..get(path, query)
            };
            assert_eq!(look(asked), Err(Refusal::OnlyGet), "{method}");
        }
        let body = Asked {
            has_body: true,
            ..get(path, query)
        };
        assert_eq!(look(body), Err(Refusal::Body));
    }
    // Foxglove's app may see a run; nothing was asked of it here.
    assert_eq!(
        look(viewer("https://app.foxglove.dev", "")),
        Err(Refusal::OtherSite)
    );
    assert_eq!(closed().look(&get("/frame", "")), Err(Refusal::Token));
    let with = get("/frame", "token=a-token-for-tests-0123");
    assert_eq!(closed().look(&with), Ok(()));
}

proptest! {
    #[test]
    fn whatever_is_sent_only_a_get_from_here_looks(
        method in prop_oneof![Just("GET".to_owned()), ".*"], path in ".*", query in ".*",
        authority in header(), host in header(), origin in header(), site in header(), mode in header(),
        authorization in header(), has_body in any::<bool>(),
    ) {
        let asked = Asked {
            method: &method, path: &path, query: &query, authority: authority.as_deref(),
            host: of(&host), origin: of(&origin), fetch_site: of(&site), fetch_mode: of(&mode),
            authorization: of(&authorization), session: Header::Absent, has_body,
        };
        for (guard, has_token) in [(loopback(), false), (closed(), true)] {
            if guard.look(&asked).is_ok() {
                prop_assert!(method == "GET" && !has_body && host.is_some());
                let named = authority.as_deref().or(host.as_deref()).unwrap();
                prop_assert!(origin.as_ref().is_none_or(|o| o.ends_with(named)));
                let shown = authorization.iter().any(|a| a.contains(TOKEN)) || query.contains(TOKEN);
                prop_assert!(!has_token || shown);
            }
        }
    }
}
