"""That the comparison can fail. `python3 tests/sample/test_judge.py`; tests/analysis/sample.rs runs it too."""
import copy
import json
import sys
import unittest
from pathlib import Path

sys.dont_write_bytecode = True
sys.path.insert(0, str(Path(__file__).resolve().parent))

from lib import judge  # noqa: E402
from lib.cases import EXPECTED, STAGES, Cases  # noqa: E402


def judged(stage: str, case: str, change) -> judge.Judged:
    """A committed result against itself after `change`."""
    a = json.loads(EXPECTED.read_text())[stage][case]
    b = copy.deepcopy(a)
    change(b)
    found = judge.Judged()
    judge.compare(stage, case, a, b, found)
    return found


class Judge(unittest.TestCase):
    def test_the_committed_sample_is_whole_and_equals_itself(self):
        expected, cases = json.loads(EXPECTED.read_text()), Cases()
        for stage in STAGES:
            self.assertEqual(sorted(expected[stage]), sorted(c.name for c in cases.of(stage)), stage)
            for case in expected[stage]:
                found = judged(stage, case, lambda _: None)
                self.assertTrue(found.passes and found.numbers == found.identical, f"{stage} {case}")
        # Of 200 frames, one of which, pitched as far as the target's end, has a reason.
        self.assertEqual(sum(len(v["poses"]) for v in expected["poses"].values()), 199)
        self.assertEqual([len(expected[s]) for s in ("calibrations", "identifications", "verdicts")], [20, 20, 20])

    def test_a_number_fails_beyond_a_hundredth_of_its_sd_and_not_below(self):
        def off(share):
            def change(result):
                estimate = result["parameters"]["x_u"]
                estimate["value"] += share * estimate["sd"]
            return change

        self.assertTrue(judged("identifications", "surge-still", off(0.009)).passes)
        found = judged("identifications", "surge-still", off(0.011))
        self.assertFalse(found.passes)
        self.assertIn("x_u value", found.judged.where)

    def test_an_sd_or_a_noise_that_changes_by_two_per_cent_fails(self):
        def sd(result):
            result["parameters"]["x_u"]["sd"] *= 1.02

        def noise(result):
            result["noise"]["x_m"]["white_sd"] *= 1.02

        def gap(result):
            result["report"]["coplanarity"]["offset_m"] += 0.02 * result["report"]["coplanarity"]["offset_sd_m"]

        self.assertFalse(judged("identifications", "surge-still", sd).passes)
        self.assertFalse(judged("identifications", "surge-still", noise).passes)
        self.assertFalse(judged("calibrations", "dots-homography", gap).passes)

    def test_a_pose_that_is_gone_fails(self):
        def drop(result):
            result["poses"].pop(next(iter(result["poses"])))

        def shift(result):
            pose = result["poses"][next(iter(result["poses"]))]
            pose["psi_rad"]["value"] += 0.02 * pose["psi_rad"]["sd"]

        self.assertFalse(judged("poses", "yawed", drop).passes)
        self.assertFalse(judged("poses", "yawed", shift).passes)

    def test_another_verdict_fails_and_another_sentence_does_not(self):
        def word(result):
            result["verdict"] = "ambiguous"

        def effect(result):
            result["effects"][0]["effect"] = "command_latency"

        def parameter(result):
            found = result["effects"][0]["parameters"]["lag_s"]
            found["value"] += 0.02 * found["sd"]

        def sentence(result):
            result["sentence"] = "Left out: a lag, indeed."

        for change in (word, effect, parameter):
            self.assertFalse(judged("verdicts", "lag", change).passes, change.__name__)
        found = judged("verdicts", "lag", sentence)
        self.assertTrue(found.passes and found.words)

    def test_other_inputs_are_named(self):
        a = {"log": {"/camera/image": "15 0badcafe", "/sim/truth": "15 00000000"}}
        b = {"log": {"/camera/image": "15 0badcafd", "/sim/truth": "15 00000000"}}
        self.assertEqual(judge.inputs_differ(a, b), ["log /camera/image: 15 0badcafe, 15 0badcafd"])


if __name__ == "__main__":
    unittest.main()
