//! The page of `palpate serve` in a real browser: headless Chromium, driven by its DevTools protocol over a pipe.
//!
//! `PALPATE_BROWSER` names the browser, and then it must work; otherwise the one on the path is taken, and where there is none
//! the test says that it did not run. `PALPATE_SCREENSHOTS` names a folder for pictures of the page.

use std::collections::VecDeque;
use std::env;
use std::fs;
use std::io::{Read as _, Write as _};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use nalgebra::Isometry2;
use palpate_tests::rig::PATIENCE;
use serde_json::{Value, json};

use crate::observe::{check_pose, example, forces, pushed};
use crate::recording::calibrated;
use crate::serve::{Finger, Serving};

/// The browser to test with; none, said aloud, where there is none.
fn browser() -> Option<PathBuf> {
    if let Some(named) = env::var_os("PALPATE_BROWSER") {
        return Some(named.into());
    }
    let names = ["chromium", "chromium-browser", "google-chrome"];
    let folders = env::var_os("PATH").unwrap_or_default();
    let found =
        env::split_paths(&folders).flat_map(|folder| names.map(|name| folder.join(name))).find(|it| it.is_file());
    if found.is_none() {
        eprintln!("NOT TESTED: the page of `palpate serve`, for want of Chromium; PALPATE_BROWSER names one");
    }
    found
}

/// A browser with one page.
struct Browser {
    child: Child,
    orders: ChildStdin,
    heard: Receiver<Value>,
    /// What came beside answers.
    events: VecDeque<Value>,
    last_id: u64,
    page: Option<String>,
    _profile: tempfile::TempDir,
}

impl Browser {
    fn start(program: &Path) -> Self {
        let profile = tempfile::tempdir().unwrap();
        let mut command = Command::new("sh");
        // The browser reads orders from descriptor 3 and answers on 4, each ended by a byte 0.
        command.args(["-c", "exec \"$@\" 3<&0 4>&1 0</dev/null 1>/dev/null", "sh"]).arg(program);
        command.args(["--headless=new", "--remote-debugging-pipe", "--no-sandbox", "--disable-gpu", "--no-first-run"]);
        command.args([
            "--disable-background-networking",
            "--disable-extensions",
            "--disable-dev-shm-usage",
            "--lang=en",
        ]);
        command.arg(format!("--user-data-dir={}", profile.path().display())).arg("about:blank");
        let mut child = command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap();
        let orders = child.stdin.take().unwrap();
        let mut answers = child.stdout.take().unwrap();
        let (sender, heard) = channel();
        std::thread::spawn(move || {
            let (mut buffer, mut waiting) = (vec![0; 1 << 16], Vec::new());
            while let Ok(length @ 1..) = answers.read(&mut buffer) {
                waiting.extend_from_slice(&buffer[..length]);
                while let Some(end) = waiting.iter().position(|byte| *byte == 0) {
                    let message: Vec<u8> = waiting.drain(..=end).collect();
                    if sender.send(serde_json::from_slice(&message[..end]).unwrap()).is_err() {
                        return;
                    }
                }
            }
        });
        let events = VecDeque::new();
        let mut browser = Self { child, orders, heard, events, last_id: 0, page: None, _profile: profile };
        let target = browser.ask("Target.createTarget", json!({ "url": "about:blank" }));
        let attach = json!({ "targetId": target["targetId"], "flatten": true });
        browser.page = Some(browser.ask("Target.attachToTarget", attach)["sessionId"].as_str().unwrap().to_owned());
        for domain in ["Page", "Runtime", "Log", "Network"] {
            browser.ask(&format!("{domain}.enable"), json!({}));
        }
        browser
    }

    fn ask(&mut self, method: &str, parameters: Value) -> Value {
        self.last_id += 1;
        let mut order = json!({ "id": self.last_id, "method": method, "params": parameters });
        if let Some(page) = &self.page {
            order["sessionId"] = json!(page);
        }
        self.orders.write_all(format!("{order}\0").as_bytes()).unwrap();
        loop {
            let heard = self
                .heard
                .recv_timeout(2 * PATIENCE)
                .unwrap_or_else(|_| panic!("the browser does not answer {method}"));
            if heard["id"] == self.last_id {
                assert!(heard["error"].is_null(), "{method}: {heard}");
                return heard["result"].clone();
            }
            self.events.push_back(heard);
        }
    }

    /// What an expression is worth on the page.
    fn value(&mut self, expression: &str) -> Value {
        let asked = json!({ "expression": expression, "returnByValue": true });
        let answer = self.ask("Runtime.evaluate", asked);
        assert!(answer["exceptionDetails"].is_null(), "{expression}: {answer}");
        answer["result"]["value"].clone()
    }

    /// Waits until an expression is true on the page.
    fn wait(&mut self, expression: &str) {
        let deadline = Instant::now() + 4 * PATIENCE;
        while self.value(expression) != true {
            let last =
                "JSON.stringify({ ...palpate, last: { ...palpate.last, points: 0, push: palpate.last?.push?.stage } })";
            assert!(Instant::now() < deadline, "{expression} does not come: {}", self.value(last));
            std::thread::sleep(Duration::from_millis(30));
        }
    }

    fn press(&mut self, key: &str) {
        for kind in ["keyDown", "keyUp"] {
            self.ask("Input.dispatchKeyEvent", json!({ "type": kind, "key": key, "text": key }));
        }
    }

    /// Sets window and colours.
    fn set(&mut self, width: u32, height: u32, scheme: &str) {
        let size = json!({ "width": width, "height": height, "deviceScaleFactor": 1, "mobile": false });
        self.ask("Emulation.setDeviceMetricsOverride", size);
        let media = json!({ "features": [{ "name": "prefers-color-scheme", "value": scheme }] });
        self.ask("Emulation.setEmulatedMedia", media);
        // A frame is drawn with them.
        let drawn = self.value("palpate.drawn").as_u64().unwrap();
        self.wait(&format!("palpate.drawn > {} && innerWidth === {width}", drawn + 2));
    }

    /// A picture of the page, where pictures are wanted.
    fn picture(&mut self, name: &str) {
        let Some(folder) = env::var_os("PALPATE_SCREENSHOTS") else { return };
        let shot = self.ask("Page.captureScreenshot", json!({ "format": "png", "captureBeyondViewport": false }));
        fs::write(PathBuf::from(folder).join(name), base64(shot["data"].as_str().unwrap())).unwrap();
    }

    /// What the page complained of, and what it asked for from elsewhere than `from`.
    fn complaints(&mut self, from: &str) -> Vec<String> {
        self.value("0");
        let is_complaint = |event: &Value| {
            let told = &event["params"];
            match event["method"].as_str().unwrap_or_default() {
                "Runtime.exceptionThrown" => true,
                "Runtime.consoleAPICalled" => ["error", "warning", "assert"].contains(&told["type"].as_str().unwrap()),
                "Log.entryAdded" => told["entry"]["level"] == "error",
                "Network.requestWillBeSent" => {
                    let url = told["request"]["url"].as_str().unwrap();
                    !url.starts_with(from) && !url.starts_with("data:")
                }
                _ => false,
            }
        };
        self.events.iter().filter(|event| is_complaint(event)).map(Value::to_string).collect()
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// The bytes that a text of 64 kinds of letters stands for.
fn base64(text: &str) -> Vec<u8> {
    let value = |letter: u8| match letter {
        b'A'..=b'Z' => Some(letter - b'A'),
        b'a'..=b'z' => Some(letter - b'a' + 26),
        b'0'..=b'9' => Some(letter - b'0' + 52),
        b'+' => Some(62),
        b'/' => Some(63),
        _ => None,
    };
    let letters: Vec<u8> = text.bytes().filter_map(value).collect();
    let bits =
        |four: &[u8]| four.iter().enumerate().fold(0_u32, |bits, (k, six)| bits | u32::from(*six) << (18 - 6 * k));
    letters.chunks(4).flat_map(|four| bits(four).to_be_bytes()[1..four.len()].to_vec()).collect()
}

/// Tares that a machine which loses samples gets.
const TARES_MAX: usize = 5;

#[test]
fn a_browser_shows_the_push_of_a_part_and_what_is_amiss() {
    let Some(program) = browser() else { return };
    let (folder, played) = (tempfile::tempdir().unwrap(), pushed());
    let folder = folder.path();
    let calibration = calibrated(folder);
    fs::write(folder.join("forces.csv"), forces(&played, 0.0, 0.0)).unwrap();
    // By their names in the folder, as a person would, and as the pictures show them.
    for name in ["part.toml", "motion.toml"] {
        fs::copy(example(name), folder.join(name)).unwrap();
    }
    let [link, motion] = ["finger", "motion.toml"].map(|name| folder.join(name).display().to_string());
    let files = ["--part", "part.toml", "--motion", "motion.toml", "--every", "0.05"];
    let words = [&["-d", "finger", "-c", &calibration][..], &files].concat();
    let token = ["--token", "a-token-for-the-test"];
    let serving = Serving::start(folder, &[&words[..], &token].concat());

    let mut browser = Browser::start(&program);
    browser.ask("Page.navigate", json!({ "url": serving.url }));
    browser.wait("window.palpate !== undefined && palpate.last !== null");
    browser.wait("document.getElementById('condition').textContent.includes('no device yet')");
    let mut finger = Finger::start(&["--link", &link]);
    browser.wait("palpate.condition === 'taring'");
    browser.wait("palpate.last.push.stage === 'ready' && palpate.condition === 'free'");
    browser.set(1100, 1010, "light");
    assert_eq!(browser.value("document.getElementById('simulated').hidden"), false);

    // Frames advance, and each block is in one.
    let frames = browser.value("palpate.frames").as_u64().unwrap();
    browser.wait(&format!("palpate.frames > {} && palpate.drawn > 30", frames + 60));

    // The estimate of the push moves, and ends where the part is.
    finger.order(&format!("play {} {motion}", folder.join("forces.csv").display()));
    browser.wait("(window.begun = palpate.last.push.belief?.poses[0]?.centre) !== undefined");
    if env::var_os("PALPATE_SCREENSHOTS").is_some() {
        // While there are many poses; held still, or they would be few before the picture is taken.
        browser.press("p");
        browser.picture("serve-ambiguous.png");
        browser.press("p");
    }
    browser.wait("palpate.last.push.stage === 'over'");
    let belief = browser.value("palpate.last.push.belief");
    assert_eq!(belief["status"], "unique", "{belief}");
    let moved = "Math.hypot(...palpate.last.push.belief.poses[0].centre.map((place, k) => place - window.begun[k]))";
    let moved = browser.value(moved).as_f64().unwrap();
    assert!(moved > 5e-3, "the estimate moved by {moved} m");
    let pose = [0, 1, 2].map(|place| belief["poses"][0]["pose"][place].as_f64().unwrap());
    let found = Isometry2::new([pose[0], pose[1]].into(), pose[2]);
    check_pose(&found, &played, belief["felt_s"].as_f64().unwrap(), &belief);
    // What is known is drawn with the next frame of the screen.
    browser.wait("document.getElementById('poses').rows.length === 1");

    // Keys: a mark, and a picture that is held still while frames go on.
    browser.press("m");
    browser.wait("palpate.last.marks.length === 1");
    browser.press("p");
    browser.wait("document.getElementById('condition').textContent.includes('paused')");
    let [drawn, frames] = ["palpate.drawn", "palpate.frames"].map(|name| browser.value(name).as_u64().unwrap());
    browser.wait(&format!("palpate.frames > {}", frames + 15));
    assert_eq!(browser.value("palpate.drawn"), drawn);
    browser.press("p");
    browser.wait(&format!("palpate.drawn > {drawn}"));

    // Narrow and wide, dark and light: nothing is wider than the window.
    finger.order("sweep 20 75 3 1.5");
    browser.wait("palpate.last.felt?.contact === true");
    let contact = browser.value("palpate.frames").as_u64().unwrap();
    browser.wait(&format!("palpate.frames > {}", contact + 75));
    for (width, height, scheme) in [(1100, 860, "light"), (1100, 860, "dark"), (390, 1720, "light")] {
        browser.set(width, height, scheme);
        let widest = browser.value("document.documentElement.scrollWidth").as_u64().unwrap();
        assert!(widest <= u64::from(width), "{widest} of {width} pixels");
        let name = if width < 500 { "narrow" } else { scheme };
        browser.picture(&format!("serve-{name}.png"));
    }
    finger.order("release");
    // A busy machine may lose samples of a tare, which is then said: like a person, again.
    for _ in 0..TARES_MAX {
        browser.press("t");
        browser.wait("palpate.condition === 'taring' && palpate.last.push.stage === 'resting'");
        browser.wait("['ready', 'unusable'].includes(palpate.last.push.stage)");
        if browser.value("palpate.last.push.stage") == "ready" {
            break;
        }
    }
    assert_eq!(browser.value("palpate.last.push.stage"), "ready");

    finger.order("unplug");
    browser.wait("document.getElementById('condition').textContent.includes('unplugged')");
    finger.order("plug");
    browser.wait("palpate.condition === 'free'");
    let counted = "palpate.samples + palpate.last.points.forming === palpate.last.counts.samples && palpate.gaps === 0 \
                   && palpate.skipped === 0 && palpate.blocks === palpate.last.counts.blocks && palpate.samples > 20000";
    assert_eq!(
        browser.value(counted),
        true,
        "{}",
        browser.value("JSON.stringify({...palpate, last: palpate.last.counts})")
    );
    let from = format!("http://{}/", serving.address);
    assert_eq!(browser.complaints(&from), [""; 0]);

    // A page of another origin gets nothing: it may neither read nor wish, with the token or without.
    browser.ask("Page.navigate", json!({ "url": "data:text/html,<title>another</title>" }));
    browser.wait("document.title === 'another'");
    let token = serving.url.split_once('?').unwrap().1;
    for query in ["", token] {
        let steal = format!(
            "window.stolen = null; const source = new EventSource('{from}events?{query}'); \
             source.onmessage = () => {{ window.stolen = 'read'; }}; source.onerror = () => {{ window.stolen ??= 'refused'; }}; 0"
        );
        browser.value(&format!("{{ {steal} }}"));
        browser.wait("window.stolen !== null");
        assert_eq!(browser.value("window.stolen"), "refused", "{query}");
        let wish = format!(
            "window.wished = null; fetch('{from}wish?{query}', {{ method: 'POST', body: 'mark', mode: 'no-cors' }})\
             .then(() => {{ window.wished = 'sent'; }}, () => {{ window.wished = 'failed'; }}); 0"
        );
        browser.value(&wish);
        browser.wait("window.wished !== null");
    }
    // And without the token not even the page.
    browser.ask("Page.navigate", json!({ "url": from }));
    browser.wait("document.body?.textContent.includes('lacks the token')");
    browser.ask("Page.navigate", json!({ "url": serving.url }));
    browser.wait("window.palpate !== undefined && palpate.last !== null");
    assert_eq!(browser.value("palpate.last.marks.length"), 1, "another origin's wish was heeded");
    // Once palpate has gone it is said.
    drop(serving);
    browser.wait("palpate.condition === 'over' || palpate.condition === 'lost'");
}
