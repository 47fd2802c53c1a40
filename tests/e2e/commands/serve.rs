//! `palpate serve` without a browser: what goes over the line, to whom, and what it says.

use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::{SocketAddr, TcpStream};
use std::path::Path;
use std::process::{Child, ChildStdin, Command, Stdio};
use std::time::Instant;

use palpate_tests::rig::PATIENCE;
use serde_json::Value;

use crate::PALPATE;
use crate::observe::{example, forces, pushed, text, unfolded};
use crate::recording::{calibrated, ok, palpate};

/// Seed of the simulated finger.
const SEED: &str = "7";

/// A program that is ended with the test.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// A simulated finger behind a pseudo-terminal, and the way to order it about.
pub(crate) struct Finger {
    _device: Running,
    orders: ChildStdin,
    pub(crate) path: String,
}

impl Finger {
    pub(crate) fn start(more: &[&str]) -> Self {
        let mut command = Command::new(PALPATE);
        command.args(["simulate-device", "--seed", SEED]).args(more);
        let mut device = command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap();
        let orders = device.stdin.take().unwrap();
        let mut answers = BufReader::new(device.stdout.take().unwrap()).lines();
        let path = answers.next().unwrap().unwrap();
        // What else it says is read, or it would wait for that.
        std::thread::spawn(move || answers.for_each(drop));
        Self { _device: Running(device), orders, path }
    }

    pub(crate) fn order(&mut self, order: &str) {
        writeln!(self.orders, "{order}").unwrap();
    }
}

/// `palpate serve`, and where.
pub(crate) struct Serving {
    program: Running,
    pub(crate) address: SocketAddr,
    /// With its token, if it has one.
    pub(crate) url: String,
    /// Another address, where one is asked for.
    #[cfg(feature = "foxglove")]
    pub(crate) more: String,
}

impl Serving {
    pub(crate) fn start(folder: &Path, arguments: &[&str]) -> Self {
        let mut command = Command::new(PALPATE);
        command.args(["serve", "--port", "0"]).args(arguments).current_dir(folder).stdin(Stdio::null());
        command.env_remove("PALPATE_DEVICE").env_remove("PALPATE_CALIBRATION").env_remove("PALPATE_TOKEN");
        let mut child = command.stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap();
        let mut told = BufReader::new(child.stdout.take().unwrap()).lines().map_while(Result::ok);
        let url = told.next().unwrap();
        #[cfg(feature = "foxglove")]
        let more = if arguments.contains(&"--foxglove") { told.next().unwrap() } else { String::new() };
        let address = url.strip_prefix("http://").and_then(|rest| rest.split('/').next()).unwrap();
        Self {
            program: Running(child),
            address: address.parse().unwrap(),
            url: url.clone(),
            #[cfg(feature = "foxglove")]
            more,
        }
    }

    /// Status and whole text of an answer.
    fn ask(&self, request: &str, headers: &[(&str, &str)], body: &str) -> (u16, String) {
        let mut stream = self.send(request, headers, body);
        let mut answer = String::new();
        stream.read_to_string(&mut answer).unwrap();
        (answer.split(' ').nth(1).unwrap().parse().unwrap(), answer)
    }

    /// Sends a request as HTTP/1.0, so that the answer comes in one piece and ends with the connection.
    fn send(&self, request: &str, headers: &[(&str, &str)], body: &str) -> TcpStream {
        let mut stream = TcpStream::connect(self.address).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        let mut text = format!("{request} HTTP/1.0\r\nContent-Length: {}\r\n", body.len());
        let host = self.address.to_string();
        let named = headers.iter().any(|(name, _)| *name == "Host");
        for (name, value) in headers.iter().copied().chain((!named).then_some(("Host", host.as_str()))) {
            text += &format!("{name}: {value}\r\n");
        }
        stream.write_all(format!("{text}\r\n{body}").as_bytes()).unwrap();
        stream
    }

    fn messages(&self) -> Messages {
        let query = self.url.split_once('?').map_or(String::new(), |(_, query)| format!("?{query}"));
        let stream = self.send(&format!("GET /events{query}"), &[], "");
        Messages { lines: BufReader::new(stream), next: None, samples: 0 }
    }

    fn wish(&self, word: &str) {
        let origin = format!("http://{}", self.address);
        let (status, answer) = self.ask("POST /wish", &[("Origin", &origin)], word);
        assert_eq!(status, 202, "{answer}");
    }

    fn ended(mut self) -> Option<i32> {
        let deadline = Instant::now() + 4 * PATIENCE;
        while Instant::now() < deadline {
            if let Some(status) = self.program.0.try_wait().unwrap() {
                return status.code();
            }
            std::thread::sleep(std::time::Duration::from_millis(20));
        }
        panic!("it does not end");
    }
}

/// A page's messages, of which each is held to what came before.
struct Messages {
    lines: BufReader<TcpStream>,
    /// The number of the next sample.
    next: Option<u64>,
    /// In points so far.
    samples: u64,
}

impl Messages {
    /// The next message; none where the stream ended.
    fn read(&mut self) -> Option<Value> {
        loop {
            let mut line = String::new();
            if self.lines.read_line(&mut line).unwrap() == 0 {
                return None;
            }
            if let Some(data) = line.strip_prefix("data: ") {
                let message: Value = serde_json::from_str(data).unwrap();
                self.check(&message);
                return Some(message);
            }
        }
    }

    /// Every sample is in one point, or counted as missing, by the device's own numbers.
    fn check(&mut self, message: &Value) {
        assert_eq!(message["points"]["skipped"], 0, "{message}");
        for point in message["points"]["of"].as_array().unwrap() {
            let [first, samples, missing] = [0, 1, 2].map(|place| point[place].as_u64().unwrap());
            assert!(self.next.is_none_or(|next| next + missing == first), "{point} after {:?}", self.next);
            self.next = Some(first + samples);
            self.samples += samples;
            if let (Some(least), Some(largest)) = (point[4].as_f64(), point[5].as_f64()) {
                assert!(0.0 <= least && least <= largest, "{point}");
            }
        }
        let forming = message["points"]["forming"].as_u64().unwrap();
        assert_eq!(self.samples + forming, message["counts"]["samples"].as_u64().unwrap(), "{message}");
    }

    /// The first message from here on that is wanted.
    fn wait(&mut self, what: &str, wanted: impl Fn(&Value) -> bool) -> Value {
        // A search of a debug build on a machine that does other things too takes a while.
        let deadline = Instant::now() + 4 * PATIENCE;
        let mut last = Value::Null;
        while Instant::now() < deadline {
            last = self.read().unwrap_or_else(|| panic!("the stream ended before {what}: {last}"));
            if wanted(&last) {
                return last;
            }
        }
        panic!("{what} did not come: {last}");
    }

    fn wait_for(&mut self, condition: &str) -> Value {
        self.wait(condition, |message| message["condition"]["is"] == condition)
    }
}

#[test]
fn a_page_is_told_of_every_sample_of_the_contact_and_of_what_is_amiss() {
    let folder = tempfile::tempdir().unwrap();
    let calibration = calibrated(folder.path());
    let mut finger = Finger::start(&["--line", "drop 0.02"]);
    let words = ["-d", &finger.path, "-c", &calibration, "--tare", "0.5"];
    let serving = Serving::start(folder.path(), &words);
    let mut page = serving.messages();
    let first = page.read().unwrap();
    assert_eq!(first["frame"], 0, "{first}");
    page.wait_for("taring");
    let free = page.wait_for("free");
    assert_eq!((&free["finger"]["simulated"], &free["finger"]["rate_hz"]), (&Value::Bool(true), &Value::from(4000)));
    finger.order("press 30 2");
    let pressed = page.wait("a settled press", |message| {
        let felt = &message["felt"];
        felt["contact"] == true && (felt["magnitude"].as_f64().unwrap() - 2.0).abs() < 0.02
    });
    let [u, u_sd] = ["u", "u_sd"].map(|name| pressed["felt"][name].as_f64().unwrap().to_degrees());
    // What the calibration is worth, and five standard deviations.
    assert!((u - 30.0).abs() < 0.3 + 5.0 * u_sd, "{u} ± {u_sd}");
    // A drop of frames is a gap, counted and shown.
    page.wait("a loss", |message| {
        message["counts"]["missing"].as_u64() > Some(0) && message["alarms"].to_string().contains("samples missing")
    });

    // A tare under load is refused, and the one before stays.
    serving.wish("tare");
    page.wait_for("taring");
    let refused = page.wait("a refusal", |message| message["told"].to_string().contains("no new tare"));
    assert!(refused["told"].to_string().contains("the one before stays"), "{refused}");
    page.wait_for("contact");
    serving.wish("mark");
    let marked = page.wait("a mark", |message| !message["marks"].as_array().unwrap().is_empty());
    assert_eq!(marked["marks"][0][1], 1);
    finger.order("release");
    page.wait_for("free");

    finger.order("unplug");
    let gone = page.wait_for("unplugged");
    assert!(gone["condition"]["words"].as_str().unwrap().starts_with("unplugged"), "{gone}");
    finger.order("plug");
    let back = page.wait_for("free");
    assert_eq!(back["counts"]["disconnections"], 1, "{back}");

    // A page that comes later has the past too.
    let mut late = serving.messages();
    let first = late.read().unwrap();
    assert!(first["points"]["of"].as_array().unwrap().len() > 100, "{first}");
}

#[test]
fn nobody_is_answered_who_may_not_be() {
    let folder = tempfile::tempdir().unwrap();
    let serving = Serving::start(folder.path(), &["-d", "tcp:127.0.0.1:1"]);
    let own = format!("http://{}", serving.address);
    let (status, page) = serving.ask("GET /", &[], "");
    assert_eq!(status, 200);
    let (head, page) = page.split_once("\r\n\r\n").unwrap();
    assert!(
        head.contains("content-security-policy: default-src 'none'") && head.contains("frame-ancestors 'none'"),
        "{head}"
    );
    // It works without a network: nothing is loaded from anywhere.
    assert!(!page.contains("http://") && !page.contains("https://"), "it names another place");
    for (headers, expected) in [
        (vec![("Origin", own.as_str())], 202),
        (vec![("Origin", "http://evil.example")], 403),
        (vec![("Origin", "null")], 403),
        (vec![("Host", "evil.example")], 403),
        (vec![("Host", "evil.example"), ("Origin", "http://evil.example")], 403),
        (vec![("Sec-Fetch-Site", "cross-site")], 403),
    ] {
        let (status, answer) = serving.ask("POST /wish", &headers, "mark");
        assert_eq!(status, expected, "{headers:?}: {answer}");
        if expected == 403 {
            for path in ["GET /events", "GET /nothing"] {
                assert_eq!(serving.ask(path, &headers, "").0, 403, "{path} {headers:?}");
            }
        }
    }
    assert_eq!(serving.ask("POST /wish", &[], "format the disk").0, 400);
    assert_eq!(serving.ask("POST /wish", &[], &"x".repeat(100_000)).0, 413);
    assert_eq!(serving.ask("GET /etc/passwd", &[], "").0, 404);
    assert_eq!(serving.ask("DELETE /events", &[], "").0, 405);

    // Who is not on this computer needs the token, which is made for the occasion.
    let serving = Serving::start(folder.path(), &["-d", "tcp:127.0.0.1:1", "--bind", "0.0.0.0"]);
    let token = serving.url.split_once("/?token=").unwrap().1.to_owned();
    assert_eq!(token.len(), 32, "{token}");
    for path in ["/", "/events", "/wish", "/nothing"] {
        assert_eq!(serving.ask(&format!("GET {path}"), &[], "").0, 401, "{path}");
        assert_eq!(serving.ask(&format!("GET {path}?token={}", "0".repeat(32)), &[], "").0, 401, "{path}");
    }
    assert_eq!(serving.ask(&format!("GET /?token={token}"), &[("Host", "bench.lab")], "").0, 200);
    let foreign = [("Host", "bench.lab"), ("Origin", "http://evil.example")];
    assert_eq!(serving.ask(&format!("POST /wish?token={token}"), &foreign, "tare").0, 403);
}

#[test]
fn a_device_that_comes_later_is_waited_for() {
    let folder = tempfile::tempdir().unwrap();
    let calibration = calibrated(folder.path());
    let link = folder.path().join("finger").display().to_string();
    let serving = Serving::start(folder.path(), &["-d", &link, "-c", &calibration, "--tare", "0.3"]);
    let mut page = serving.messages();
    let none = page.wait("a word on the device", |message| {
        message["condition"]["words"].as_str().unwrap().contains("there is no port")
    });
    assert_eq!((&none["condition"]["is"], &none["finger"]), (&Value::from("no_device"), &Value::Null));
    let _finger = Finger::start(&["--link", &link]);
    let free = page.wait_for("free");
    assert_eq!(free["finger"]["address"], link.as_str());
    // Two cannot have one port, and what to do is said.
    let port = serving.address.port().to_string();
    let second = palpate(folder.path(), &["serve", "-d", "sim:7", "--port", &port]);
    let said = text(&second.stderr);
    assert!(second.status.code() == Some(1) && unfolded(&said).contains("choose another --port"), "{said}");
}

#[test]
fn pages_that_never_read_keep_nobody_waiting() {
    let folder = tempfile::tempdir().unwrap();
    let calibration = calibrated(folder.path());
    let serving = Serving::start(folder.path(), &["-d", "sim:7", "-c", &calibration, "--tare", "0.3"]);
    let mut page = serving.messages();
    page.wait_for("free");
    let deaf: Vec<_> = (0..31).map(|_| serving.send("GET /events", &[], "")).collect();
    // More than that are told so.
    page.read().unwrap();
    let deadline = Instant::now() + PATIENCE;
    while serving.ask("GET /", &[], "").0 != 200 {
        assert!(Instant::now() < deadline);
    }
    let (status, answer) = serving.ask("GET /events", &[], "");
    assert_eq!(status, 503, "{answer}");
    let before = page.read().unwrap()["counts"]["blocks"].as_u64().unwrap();
    // Two seconds of samples, all of which the page that reads is told of: `read` holds it to that.
    let after = page.wait("two seconds", |message| message["counts"]["blocks"].as_u64().unwrap() > before + 1000);
    assert_eq!(after["counts"]["missing"], 0, "{after}");
    drop(deaf);
}

#[test]
fn a_pushed_part_is_shown_where_it_is_live_and_from_the_recording() {
    let (folder, played) = (tempfile::tempdir().unwrap(), pushed());
    let folder = folder.path();
    let calibration = calibrated(folder);
    std::fs::write(folder.join("forces.csv"), forces(&played, 0.0, 0.0)).unwrap();
    let mut finger = Finger::start(&[]);
    let [part, motion] = ["part.toml", "motion.toml"].map(|name| example(name).display().to_string());
    let words = ["-c", &calibration, "--part", &part, "--motion", &motion];
    let recorded = [&words[..], &["-d", &finger.path, "--record", "run.mcap", "--seconds", "6"]].concat();
    let serving = Serving::start(folder, &recorded);
    let mut page = serving.messages();
    let is_stage = |stage: &'static str| move |message: &Value| message["push"]["stage"] == stage;
    page.wait("ready", is_stage("ready"));
    finger.order(&format!("play {} {motion}", folder.join("forces.csv").display()));
    let watch = |page: &mut Messages| {
        let moving = page.wait("an estimate", |message| message["push"]["belief"]["poses"][0].is_object());
        let over = page.wait("the end of the push", is_stage("over"));
        let place = |message: &Value| {
            [0, 1].map(|axis| message["push"]["belief"]["poses"][0]["centre"][axis].as_f64().unwrap())
        };
        let ([x, y], [x_end, y_end]) = (place(&moving), place(&over));
        assert!((x_end - x).hypot(y_end - y) > 5e-3, "the estimate does not move: {over}");
        let belief = &over["push"]["belief"];
        assert_eq!((&belief["status"], &belief["is_last"]), (&Value::from("unique"), &Value::Bool(true)), "{belief}");
        let truth = played.pose(belief["felt_s"].as_f64().unwrap()).unwrap();
        let pose = [0, 1, 2].map(|place| belief["poses"][0]["pose"][place].as_f64().unwrap());
        let distance = (pose[0] - truth.translation.x).hypot(pose[1] - truth.translation.y);
        assert!(distance < 5e-4, "off by {distance:e} m: {belief}");
        if over["condition"]["is"] != "over" {
            page.wait_for("over");
        }
    };
    watch(&mut page);
    assert_eq!(serving.ended(), Some(0));
    drop(finger);
    // Of the recording it is the same, at its own speed.
    let again = Serving::start(folder, &[&words[..], &["-d", "file:run.mcap"]].concat());
    watch(&mut again.messages());
    ok(&palpate(folder, &["recover", "run.mcap"]));
}
