# A request for every route, in the order in which they work against `thermap demo`.
#
# Above each stands the status of its answer and what it is for; an empty line parts them.
# What is looked at is the demo's machine, mcfv5050. What is changed is a machine `practice`
# that these requests make, and delete at the end; numbers of maps, verifications and
# analyses are those of a new database.
# A route that is not here fails tests/test_http_requests.py, which sends them all.

# 200: does it live?
curl http://127.0.0.1:8000/healthz

# 200: is the database there, are all models in memory?
curl http://127.0.0.1:8000/readyz

# 200: for Prometheus
curl http://127.0.0.1:8000/metrics

# 200
curl http://127.0.0.1:8000/v1/machines

# 200
curl http://127.0.0.1:8000/v1/machines/mcfv5050

# 200: whether each machine can be trusted now, and why not
curl http://127.0.0.1:8000/v1/status

# 200: the same of one
curl http://127.0.0.1:8000/v1/machines/mcfv5050/status

# 200: how what the service reads beside HTTP fares
curl http://127.0.0.1:8000/v1/connections

# 200: who is told of alarms, and how that went
curl http://127.0.0.1:8000/v1/receivers

# 404: no file of connections names a receiver here
curl -X POST http://127.0.0.1:8000/v1/receivers/maintenance/test

# 200: what happened to it
curl http://127.0.0.1:8000/v1/machines/mcfv5050/events

# 200: what happened to all machines
curl http://127.0.0.1:8000/v1/events

# 403: who may ask for what; 200 where the service asks for keys, with an admin's
curl http://127.0.0.1:8000/v1/keys

# 403: where the service asks for keys 201, and the key itself, this once
curl -X POST http://127.0.0.1:8000/v1/keys \
     -H "Content-Type: application/json" \
     -d '{"name": "line-3", "role": "sensor", "machines": ["mcfv5050"]}'

# 403: where the service asks for keys 204, and the key is none any more
curl -X DELETE http://127.0.0.1:8000/v1/keys/line-3

# 200: the table now
curl http://127.0.0.1:8000/v1/machines/mcfv5050/compensation

# 200: 304 without the table where it is still the one with this ETag
curl http://127.0.0.1:8000/v1/machines/mcfv5050/compensation -H 'If-None-Match: "an ETag that came"'

# 200: the table now, and whenever a value has changed by more than 0.5 µm
curl -N "http://127.0.0.1:8000/v1/machines/mcfv5050/compensation/stream?min_change_um=0.5"

# 200: alarms, changes, what the watch says and how far analyses are, without tables
curl -N "http://127.0.0.1:8000/v1/machines/mcfv5050/compensation/stream?kind=event&kind=watch&kind=analysis"

# 200: the same of every machine
curl -N http://127.0.0.1:8000/v1/stream

# 200: the table at these temperatures [°C]
curl -X POST http://127.0.0.1:8000/v1/machines/mcfv5050/compensation \
     -H "Content-Type: application/json" \
     -d '{"temperatures_c": {"x-middle": 24.1, "y-front": 23.9, "z-column": 27.3}}'

# 200: which controllers' files there are
curl http://127.0.0.1:8000/v1/controllers

# 200: now, as LinuxCNC's compensation files
curl -X POST "http://127.0.0.1:8000/v1/machines/mcfv5050/compensation/export?controller=linuxcnc" \
     -H "Content-Type: application/json" -d '{}'

# 200: as Siemens' tables over a range of temperatures [°C], in a zip
curl -X POST "http://127.0.0.1:8000/v1/machines/mcfv5050/compensation/export?controller=siemens-cec" \
     -H "Content-Type: application/json" -H "Accept: application/zip" -o tables.zip \
     -d '{"options": {"sign": "error"}, "bands": {
          "from_c": {"x-middle": 20.5, "y-front": 20.4, "z-column": 21.0},
          "to_c": {"x-middle": 24.1, "y-front": 23.9, "z-column": 27.3}, "largest_step_um": 10}}'

# 200: what a controller's file holds
curl -X POST http://127.0.0.1:8000/v1/controllers/linuxcnc/parse \
     -H "Content-Type: application/json" \
     -d '{"files": [{"name": "x.comp", "content": "0 0 0\n250 -0.004 -0.003\n"}]}'

# 200: against what it should hold now
curl -X POST "http://127.0.0.1:8000/v1/machines/mcfv5050/compensation/compare?controller=linuxcnc" \
     -H "Content-Type: application/json" \
     -d '{"files": [{"name": "x.comp", "content": "0 0 0\n250 -0.004 -0.003\n"}]}'

# 200: the oldest three, at most one a minute
curl "http://127.0.0.1:8000/v1/machines/mcfv5050/readings?every_s=60&limit=3"

# 200: the same over hours to years, in bins; as a table with Accept: text/csv
curl "http://127.0.0.1:8000/v1/machines/mcfv5050/history?sensor=x-middle"

# 200
curl http://127.0.0.1:8000/v1/machines/mcfv5050/error-maps

# 200
curl http://127.0.0.1:8000/v1/machines/mcfv5050/error-maps/1

# 200: the same as a file, which can be stored again
curl http://127.0.0.1:8000/v1/machines/mcfv5050/error-maps/1/file

# 200: an empty file to fill in, with the machine's sensors and components
curl "http://127.0.0.1:8000/v1/machines/mcfv5050/files/template?kind=check"

# 200: which sensor each component follows
curl http://127.0.0.1:8000/v1/machines/mcfv5050/sensor-assignment

# 200: which one each should follow, as the maps have it
curl -X POST http://127.0.0.1:8000/v1/machines/mcfv5050/sensor-assignment/correlate

# 200
curl http://127.0.0.1:8000/v1/machines/mcfv5050/models

# 200
curl http://127.0.0.1:8000/v1/machines/mcfv5050/models/3

# 200: which components its tables have, and why they lack others
curl http://127.0.0.1:8000/v1/machines/mcfv5050/models/3/coverage

# 200: the kinds of machines that are not rigid
curl http://127.0.0.1:8000/v1/nonrigid-presets

# 200: which errors one of them must have measured, and which the model lacks
curl "http://127.0.0.1:8000/v1/machines/mcfv5050/needed-components?preset=large-gantry&tool_length_mm=160"

# 200: the error at two points, with a tool of 160 mm, at the latest reading
curl -X POST http://127.0.0.1:8000/v1/machines/mcfv5050/volumetric-error \
     -H "Content-Type: application/json" \
     -d '{"points_mm": [[0, 0, 0], [500, 500, 400]], "tool_offset_mm": [0, 0, 160]}'

# 200: the same as a numpy array: `numpy.load("errors.npy")`
curl -X POST http://127.0.0.1:8000/v1/machines/mcfv5050/volumetric-error \
     -H "Content-Type: application/json" -H "Accept: application/x-npy" -o errors.npy \
     -d '{"points_mm": [[0, 0, 0], [500, 500, 400]], "tool_offset_mm": [0, 0, 160]}'

# 200
curl -X POST http://127.0.0.1:8000/v1/machines/mcfv5050/volumetric-accuracy \
     -H "Content-Type: application/json" \
     -d '{"temperatures_c": {"x-middle": 24.1, "y-front": 23.9, "z-column": 27.3}}'

# 200: Table 8.2's laser measurements
curl -X POST http://127.0.0.1:8000/v1/volumetric-accuracy/from-lines \
     -H "Content-Type: application/json" \
     -d '{"linear_um": {"x": [9.5, 7.2], "y": [15.8, 12.0], "z": [14.3, 25.2]},
          "straightness_um": {"EYX": 2.9, "EZX": 2.4, "EXY": 2.4, "EZY": 2.3, "EXZ": 15.9, "EYZ": 6.1}}'

# 200: at stated nodes
curl -X POST http://127.0.0.1:8000/v1/machines/mcfv5050/compensation/grid \
     -H "Content-Type: application/json" \
     -d '{"x_mm": [0, 250, 500], "y_mm": [0, 250, 500], "z_mm": [0, 200, 400]}'

# 200: the coarsest even grid that keeps 5 µm
curl -X POST http://127.0.0.1:8000/v1/machines/mcfv5050/compensation/grid \
     -H "Content-Type: application/json" \
     -d '{"tolerance_um": 5}'

# 200
curl -X POST http://127.0.0.1:8000/v1/machines/mcfv5050/compensation/levels \
     -H "Content-Type: application/json" \
     -d '{"points_per_axis": 5, "tool_offset_mm": [0, 0, 160]}'

# 200: the demo's machine has no rotary axis, so that its location errors are said to be zero
curl -X POST http://127.0.0.1:8000/v1/machines/mcfv5050/rotary-axis-error \
     -H "Content-Type: application/json" \
     -d '{"order": "AC", "angles_deg": {"A": -30, "C": [0, 90, 180]},
          "points_mm": [[100, 0, 50]], "missing_components": "zero"}'

# 200: as numbers; a browser is shown the page
curl http://127.0.0.1:8000/v1/machines/mcfv5050/picture

# 200: the page, as a file that needs no other: it contains plotly, some 5 MB
curl -X POST http://127.0.0.1:8000/v1/machines/mcfv5050/picture \
     -H "Content-Type: application/json" -H "Accept: text/html" -o picture.html \
     -d '{"temperatures_c": {"x-middle": 24.1, "y-front": 23.9, "z-column": 27.3},
          "tool_offset_mm": [0, 0, 160]}'

# 200: two steps of each axis, with 0.2 µm of noise
curl -X POST http://127.0.0.1:8000/v1/machines/mcfv5050/measurements/step-diagonal/simulate \
     -H "Content-Type: application/json" \
     -d '{"steps": 2, "noise_um": 0.2}'

# 200: looked at, not stored
curl -X POST http://127.0.0.1:8000/v1/machines/mcfv5050/measurements/step-diagonal \
     -H "Content-Type: application/json" \
     -d '{"origin_mm": [0, 0, 0], "step_mm": [250, 250, 200],
          "diagonals": {"ppp": [[0.4, 0.9, 1.1], [1.6, 2.0, 2.3]],
                        "npp": [[0.2, 0.7, 0.9], [1.1, 1.6, 1.8]],
                        "pnp": [[0.5, 0.8, 1.0], [1.4, 1.8, 2.1]],
                        "ppn": [[0.3, 0.8, 0.9], [1.3, 1.7, 1.8]]}}'

# 200: looked at, not stored
curl -X POST http://127.0.0.1:8000/v1/machines/mcfv5050/measurements/body-diagonal \
     -H "Content-Type: application/json" \
     -d '{"diagonals": {"ppp": {"positions_mm": [0, 812.4], "forward_um": [0, 12.1]},
                        "npp": {"positions_mm": [0, 812.4], "forward_um": [0, 8.4]},
                        "pnp": {"positions_mm": [0, 812.4], "forward_um": [0, 9.9]},
                        "ppn": {"positions_mm": [0, 812.4], "forward_um": [0, 10.2]}}}'

# 200: looked at, not stored
curl -X POST http://127.0.0.1:8000/v1/machines/mcfv5050/measurements/six-dof \
     -H "Content-Type: application/json" \
     -d '{"axis": "x", "positions_mm": [0, 250, 500], "linear_um": [0, 1.4, 2.9],
          "straightness_um": {"y": [0, 0.6, 0.1], "z": [0, -0.4, 0.3]},
          "angular_urad": {"a": [0, 2, 5], "b": [0, 8, 15], "c": [0, -3, -4]},
          "measuring_line_mm": [0, 250, 100]}'

# 200: compared with the model at the temperatures at which the part was cut
curl -X POST http://127.0.0.1:8000/v1/machines/mcfv5050/measurements/machined-part \
     -H "Content-Type: application/json" \
     -d '{"component": "EXY", "positions_mm": [0, 50, 100, 150], "measured_um": [0, 1.2, 1.6, 0.7],
          "temperatures_c": {"x-middle": 24.1, "y-front": 23.9, "z-column": 27.3}}'

# 200: looked at, not stored
curl -X POST http://127.0.0.1:8000/v1/machines/mcfv5050/measurements/drilled-plate \
     -H "Content-Type: application/json" \
     -d '{"holes": [{"nominal_mm": [0, 0], "measured_mm": [0, 0]},
                    {"nominal_mm": [200, 0], "measured_mm": [200.004, 0]},
                    {"nominal_mm": [0, 100], "measured_mm": [0.001, 100]},
                    {"nominal_mm": [200, 100], "measured_mm": [200.005, 100]}]}'

# 200: looked at, not stored
curl -X POST http://127.0.0.1:8000/v1/machines/mcfv5050/measurements/thermal-drift \
     -H "Content-Type: application/json" \
     -d '{"test": "spindle", "point_mm": [250, 200, 200], "tool_offset_mm": [0, 0, 160],
          "readings": [{"time": "2026-03-01T06:00:00Z", "x_um": 0.2, "y_um": -0.1, "z_um": 0.0,
                        "temperatures_c": {"x-middle": 20.1, "y-front": 20.0, "z-column": 20.3}},
                       {"time": "2026-03-01T06:30:00Z", "x_um": 1.1, "y_um": 2.4, "z_um": 9.3,
                        "temperatures_c": {"x-middle": 20.4, "y-front": 20.2, "z-column": 23.9}},
                       {"time": "2026-03-01T07:00:00Z", "x_um": 1.6, "y_um": 3.9, "z_um": 14.2,
                        "temperatures_c": {"x-middle": 20.9, "y-front": 20.5, "z-column": 26.1}}]}'

# 200: looked at, not stored
curl -X POST http://127.0.0.1:8000/v1/machines/mcfv5050/measurements/rotary-axis \
     -H "Content-Type: application/json" \
     -d '{"axis": "C", "points": [{"angle_deg": 0, "position_mm": [101.0, 0.0, 50.0]},
                                  {"angle_deg": 90, "position_mm": [0.0, 101.0, 50.0]},
                                  {"angle_deg": 180, "position_mm": [-101.0, 0.0, 50.0]}]}'

# 201: a machine to practise on
curl -X POST http://127.0.0.1:8000/v1/machines \
     -H "Content-Type: application/json" \
     -d '{"id": "practice", "name": "To practise on", "configuration": "XYFZ",
          "axes": {"x": {"min_mm": 0, "max_mm": 500}},
          "sensors": [{"name": "x-middle", "stand_in": "y-front"}, {"name": "y-front"}]}'

# 200: what is not stated stays
curl -X PATCH http://127.0.0.1:8000/v1/machines/practice \
     -H "Content-Type: application/json" \
     -d '{"name": "To practise on, renamed", "axes": {"y": {"min_mm": 0, "max_mm": 400}}}'

# 201: measured cold
curl -X POST http://127.0.0.1:8000/v1/machines/practice/error-maps \
     -H "Content-Type: application/json" \
     -d '{"label": "cold", "measured_at": "2026-03-01T06:00:00Z",
          "temperatures_c": {"x-middle": 20.0, "y-front": 20.0},
          "components": [{"component": "EXX", "positions_mm": [0, 250, 500], "errors_um": [0, 0.4, 1.0]}]}'

# 200: measured warm by an instrument, evaluated, and stored as a map
curl -X POST "http://127.0.0.1:8000/v1/machines/practice/measurements/positioning?store=true" \
     -H "Content-Type: application/json" \
     -d '{"label": "warm", "measured_at": "2026-03-01T09:00:00Z",
          "temperatures_c": {"x-middle": 24.0, "y-front": 23.8},
          "axis": "x", "targets_mm": [0, 250, 500],
          "forward_um": [[0.0, 4.2, 9.0], [0.2, 4.0, 9.3]]}'

# 200: EXX follows y-front from now on
curl -X PUT http://127.0.0.1:8000/v1/machines/practice/sensor-assignment \
     -H "Content-Type: application/json" \
     -d '{"EXX": "y-front"}'

# 200: what would tables lose, gain and change by the version before? Nothing is activated
curl -X POST "http://127.0.0.1:8000/v1/machines/practice/models/2/activate?preview=true"

# 200: and x-middle again, as in that version
curl -X POST http://127.0.0.1:8000/v1/machines/practice/models/2/activate

# 201
curl -X POST http://127.0.0.1:8000/v1/machines/practice/readings \
     -H "Content-Type: application/json" \
     -d '[{"time": "2026-03-02T06:00:00Z", "temperatures_c": {"x-middle": 22.0, "y-front": 21.9}},
          {"time": "2026-03-02T06:05:00Z", "temperatures_c": {"x-middle": 22.1, "y-front": 22.0}},
          {"time": "2026-03-02T06:10:00Z", "temperatures_c": {"x-middle": 22.2, "y-front": 22.1}},
          {"time": "2026-03-02T06:15:00Z", "temperatures_c": {"x-middle": 22.3, "y-front": 22.2}},
          {"time": "2026-03-02T06:20:00Z", "temperatures_c": {"x-middle": 22.4, "y-front": 22.3}}]'

# 200: between two readings
curl -X POST http://127.0.0.1:8000/v1/machines/practice/predictions \
     -H "Content-Type: application/json" \
     -d '{"observations": [{"time": "2026-03-02T06:02:00Z", "component": "EXX", "position_mm": 250}]}'

# 201: EXX from both sides; the machine reverses by 6 µm, of which the maps know nothing
curl -X POST http://127.0.0.1:8000/v1/machines/practice/verifications \
     -H "Content-Type: application/json" \
     -d '{"label": "night shift", "repeatability_um": 0.3, "observations": [
          {"time": "2026-03-02T06:01:00Z", "component": "EXX", "position_mm": 100, "direction": "+", "measured_um": 4.1},
          {"time": "2026-03-02T06:02:00Z", "component": "EXX", "position_mm": 250, "direction": "+", "measured_um": 5.2},
          {"time": "2026-03-02T06:03:00Z", "component": "EXX", "position_mm": 300, "direction": "+", "measured_um": 6.2},
          {"time": "2026-03-02T06:04:00Z", "component": "EXX", "position_mm": 400, "direction": "+", "measured_um": 7.0},
          {"time": "2026-03-02T06:05:00Z", "component": "EXX", "position_mm": 500, "direction": "+", "measured_um": 8.5},
          {"time": "2026-03-02T06:11:00Z", "component": "EXX", "position_mm": 500, "direction": "-", "measured_um": 2.6},
          {"time": "2026-03-02T06:12:00Z", "component": "EXX", "position_mm": 400, "direction": "-", "measured_um": 1.6},
          {"time": "2026-03-02T06:13:00Z", "component": "EXX", "position_mm": 300, "direction": "-", "measured_um": 0.0},
          {"time": "2026-03-02T06:14:00Z", "component": "EXX", "position_mm": 250, "direction": "-", "measured_um": -0.3},
          {"time": "2026-03-02T06:15:00Z", "component": "EXX", "position_mm": 100, "direction": "-", "measured_um": -2.2}]}'

# 200
curl http://127.0.0.1:8000/v1/machines/practice/verifications

# 200
curl http://127.0.0.1:8000/v1/machines/practice/verifications/1

# 200: the same as a file
curl http://127.0.0.1:8000/v1/machines/practice/verifications/1/file

# 200: what the model leaves of it
curl http://127.0.0.1:8000/v1/machines/practice/verifications/1/residuals

# 200: every single residual, as a table
curl http://127.0.0.1:8000/v1/machines/practice/verifications/1/residuals -H "Accept: text/csv"

# 200: of several together, the page that a browser shows
curl -X POST http://127.0.0.1:8000/v1/machines/practice/residuals \
     -H "Content-Type: application/json" -H "Accept: text/html" -o residuals.html \
     -d '{"verifications": [1]}'

# 200
curl -X POST http://127.0.0.1:8000/v1/machines/practice/models/compare \
     -H "Content-Type: application/json" \
     -d '{"verifications": [1], "versions": [2, 3]}'

# 200: does the active model still hold?
curl http://127.0.0.1:8000/v1/machines/practice/watch

# 200: both directions at one place: what would that see?
curl -X POST http://127.0.0.1:8000/v1/machines/practice/analyses/plan \
     -H "Content-Type: application/json" \
     -d '{"planned": [{"repeatability_um": 0.3, "observations": [
          {"time": "2026-03-02T06:01:00Z", "component": "EXX", "position_mm": 250, "direction": "+"},
          {"time": "2026-03-02T06:02:00Z", "component": "EXX", "position_mm": 250, "direction": "-"}]}],
          "verifications": [1]}'

# 202: only reversal is looked for; without `effects` all kinds are
curl -X POST http://127.0.0.1:8000/v1/machines/practice/analyses \
     -H "Content-Type: application/json" \
     -d '{"verifications": [1], "effects": ["backlash"]}'

# 202: another one, to be cancelled
curl -X POST http://127.0.0.1:8000/v1/machines/practice/analyses \
     -H "Content-Type: application/json" \
     -d '{"verifications": [1]}'

# 200
curl -X POST http://127.0.0.1:8000/v1/machines/practice/analyses/2/cancel

# 200
curl http://127.0.0.1:8000/v1/machines/practice/analyses

# 200: its `status` says when it is done, seconds later; then its result is there
curl http://127.0.0.1:8000/v1/machines/practice/analyses/1

# 200 when it is done, 409 before
curl http://127.0.0.1:8000/v1/machines/practice/analyses/1/report -o analysis.html

# 200 when it is done, 409 before: the visits to make, to print
curl http://127.0.0.1:8000/v1/machines/practice/analyses/1/visits -o visits.html

# 404 when it is done, 409 before: it proposes fewer; one of them is a CSV file
curl http://127.0.0.1:8000/v1/machines/practice/analyses/1/visits/99

# 200 when it is done, 409 before: stated, as one short visit cannot show that it helps
curl -X POST http://127.0.0.1:8000/v1/machines/practice/analyses/1/adopt \
     -H "Content-Type: application/json" \
     -d '{"effects": [0]}'

# 200: how far the analyses of all machines are, and once they ended what they say together
curl "http://127.0.0.1:8000/v1/fleet?effects=backlash"

# 202: asks for those that are missing; `done` lists the machines
curl -X POST http://127.0.0.1:8000/v1/fleet/analyses \
     -H "Content-Type: application/json" \
     -d '{"effects": ["backlash"]}'

# 200: cancels those that wait or run
curl -X POST http://127.0.0.1:8000/v1/fleet/analyses/cancel \
     -H "Content-Type: application/json" \
     -d '{"effects": ["backlash"]}'

# 422: an effect is tried on another machine than the one on which it was found
curl -X POST http://127.0.0.1:8000/v1/fleet/tried-effects \
     -H "Content-Type: application/json" \
     -d '{"machine": "practice", "analysis": 1, "effect": 0, "on": "practice", "verifications": [1]}'

# 204: the model version that was made of it stays
curl -X DELETE http://127.0.0.1:8000/v1/machines/practice/analyses/1

# 204
curl -X DELETE http://127.0.0.1:8000/v1/machines/practice/verifications/1

# 201: what stands in a CSV file
curl -X POST "http://127.0.0.1:8000/v1/machines/practice/files?name=night.csv" \
     -H "Content-Type: text/csv" \
     -d '     # label: second night
     time,component,position_mm,direction,measured_um
     2026-03-01T12:00:00Z,EXX,250,+,4.31'

# 200: what a map in a CSV file would change
curl -X POST "http://127.0.0.1:8000/v1/machines/practice/files?preview=true&name=hot.csv" \
     -H "Content-Type: text/csv" \
     -d '     # label: hot
     # measured_at: 2026-03-01T12:00:00Z
     # temperature x-middle: 28.0
     # temperature y-front: 27.5
     component,position_mm,error_um
     EXX,0,0
     EXX,500,4.0'

# 200: how a file was read that is recognised as check measurements; a map would be answered as above
curl -X POST "http://127.0.0.1:8000/v1/machines/practice/files?preview=true&name=third.csv" \
     -H "Content-Type: text/csv" \
     -d '     # label: third night
     time,component,position_mm,direction,measured_um
     2026-03-01T13:00:00Z,EXX,250,+,4.29'

# 200: what the map of an instrument's readings would change; the file does not say when they were read, at which temperatures
curl -X POST "http://127.0.0.1:8000/v1/machines/practice/files?preview=true&name=x.csv&method=positioning&axis=x&label=hot&measured_at=2026-03-01T12:00:00Z&temperature=x-middle=28.0&temperature=y-front=27.5" \
     -H "Content-Type: text/csv" \
     -d '     target_mm,forward_1_um,forward_2_um
     0,0.0,0.2
     250,1.9,2.1
     500,4.1,3.9'

# 200: what tables would lose without the map "warm"
curl -X DELETE "http://127.0.0.1:8000/v1/machines/practice/error-maps/5?preview=true"

# 204: the map "warm"
curl -X DELETE http://127.0.0.1:8000/v1/machines/practice/error-maps/5

# 200: they count nowhere any more
curl -X DELETE "http://127.0.0.1:8000/v1/machines/practice/readings?from=2026-03-02T06:10:00Z&to=2026-03-02T06:20:00Z"

# 200: they are kept, with when they were withdrawn
curl http://127.0.0.1:8000/v1/machines/practice/readings/withdrawn

# 204: with all that these requests made
curl -X DELETE http://127.0.0.1:8000/v1/machines/practice
