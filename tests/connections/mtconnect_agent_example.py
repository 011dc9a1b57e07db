"""A small MTConnect agent on a port of its own, with a buffer that overruns and a will to fail."""

import threading
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from urllib.parse import parse_qs, urlsplit

PROBE = """<?xml version="1.0" encoding="UTF-8"?>
<MTConnectDevices xmlns="urn:mtconnect.org:MTConnectDevices:{version}">
<Header instanceId="{instance}" bufferSize="8"/><Devices><Device id="d" name="VMC" uuid="1">
<DataItems>
<DataItem category="SAMPLE" id="t1" name="spindle_t" type="TEMPERATURE" units="CELSIUS"/>
<DataItem category="SAMPLE" id="t2" name="column_t" type="TEMPERATURE" units="FAHRENHEIT"/>
<DataItem category="SAMPLE" id="s1" name="Srpm" type="ROTARY_VELOCITY" units="REVOLUTION/MINUTE"/>
<DataItem category="SAMPLE" id="a" name="twice" type="LOAD"/>
<DataItem category="SAMPLE" id="b" name="twice" type="LOAD"/>
</DataItems></Device></Devices></MTConnectDevices>"""

STREAMS = """<?xml version="1.0" encoding="UTF-8"?>
<MTConnectStreams xmlns="urn:mtconnect.org:MTConnectStreams:{version}">
<Header instanceId="{instance}" bufferSize="8" firstSequence="{first}" lastSequence="{last}"
 nextSequence="{next}"/><Streams><DeviceStream name="VMC" uuid="1">
<ComponentStream component="Spindle" componentId="c"><Samples>{observations}</Samples>
</ComponentStream></DeviceStream></Streams></MTConnectStreams>"""

OLD_ERROR = """<MTConnectError xmlns="urn:mtconnect.org:MTConnectError:1.3"><Header instanceId="1"/>
<Errors><Error errorCode="OUT_OF_RANGE">'from' must be greater than 9</Error></Errors>
</MTConnectError>"""

NEW_ERROR = """<MTConnectError xmlns="urn:mtconnect.org:MTConnectError:2.6"><Header instanceId="1"/>
<Errors><OutOfRange errorCode="OUT_OF_RANGE"><URI>http://h/sample?from=3</URI><Request>MTConnectSample
</Request><ErrorMessage>'from' must be greater than 9</ErrorMessage><QueryParameter name="from">
<Maximum>20</Maximum><Minimum>9</Minimum><Value>3</Value></QueryParameter></OutOfRange></Errors>
</MTConnectError>"""

BOMB = """<?xml version="1.0"?><!DOCTYPE x [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;">
]><MTConnectStreams>&b;</MTConnectStreams>"""


class ExampleAgent:
    """What it observed, the last eight of it in its buffer, and what it answers instead."""

    def __init__(self):
        self.version, self.instance, self.error = "1.3", 1, OLD_ERROR
        self.all, self.size, self.instead = [], 8, None
        self.asked = []

    def observe(self, item, text):
        self.all.append((len(self.all) + 1, item, text))

    def restart(self):
        self.instance += 1
        self.all = []

    @property
    def first(self):
        return self.all[-self.size :][0][0] if self.all else 1

    def streams(self, rows):
        observations = "".join(
            f'<Temperature dataItemId="{item}" sequence="{number}" '
            f'timestamp="2026-03-01T06:00:{number % 60:02}.123456Z">{text}</Temperature>'
            for number, item, text in rows
        )
        last = len(self.all)
        return STREAMS.format(
            version=self.version,
            instance=self.instance,
            first=self.first,
            last=last,
            next=rows[-1][0] + 1 if rows else last + 1,
            observations=observations,
        )

    def answer(self, question, asked):
        if self.instead is not None:
            return self.instead
        if question == "probe":
            return PROBE.format(version=self.version, instance=self.instance)
        if question == "current":
            latest = {item: (number, item, text) for number, item, text in self.all}
            rows = sorted(latest.values())
            document = self.streams(rows)
            return document.replace(
                f'nextSequence="{rows[-1][0] + 1 if rows else len(self.all) + 1}"',
                f'nextSequence="{len(self.all) + 1}"',
            )
        since, count = int(asked["from"][0]), int(asked["count"][0])
        if count > self.size:
            # As cppagent does, with the code that stands for a gap too.
            return self.error.replace("'from' must be greater than 9", "'count' must be less")
        if not self.first <= since <= len(self.all) + 1:
            return self.error
        return self.streams([row for row in self.all if row[0] >= since][:count])


@contextmanager
def listening(agent, port=0):
    """Let an agent answer; gives its URL."""

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self):
            url = urlsplit(self.path)
            asked = parse_qs(url.query)
            question = url.path.rpartition("/")[2]
            agent.asked.append(question)
            content = agent.answer(question, asked)
            content = content.encode() if isinstance(content, str) else content
            self.send_response(200)
            if "interval" in asked and agent.instead is None:
                self.stream(asked)
                return
            self.send_header("Content-Type", "text/xml")
            self.send_header("Content-Length", str(len(content)))
            self.end_headers()
            self.wfile.write(content)

        def stream(self, asked):
            self.send_header("Content-Type", "multipart/x-mixed-replace;boundary=abc")
            self.end_headers()
            since = int(asked["from"][0])
            while not ended.wait(0.05) and agent.instead is None:
                content = agent.answer(
                    "sample", {"from": [str(since)], "count": asked["count"]}
                ).encode()
                since = len(agent.all) + 1
                head = f"--abc\r\nContent-type: text/xml\r\nContent-length: {len(content)}\r\n\r\n"
                self.wfile.write(head.encode() + content + b"\r\n")

        def log_message(self, *_):
            pass

    ended = threading.Event()
    server = ThreadingHTTPServer(("127.0.0.1", port), Handler)
    thread = threading.Thread(target=server.serve_forever, args=(0.02,))
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_address[1]}"
    finally:
        ended.set()
        server.shutdown()
        server.server_close()
        thread.join()
