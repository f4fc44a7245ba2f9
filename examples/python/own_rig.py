"""A rig of one's own: here the simulated plate, driven by samples and read by arrays as a sound card and a camera are."""

import upm


class MyRig(upm.Rig):
    """Replace each body by calls to the hardware."""

    def __init__(self, job, seed=None):
        self.plate = upm.simulated_plate(job, seed=seed)
        self.sample_hz = self.plate.sample_hz
        self.accelerometer_hz = self.plate.accelerometer_hz
        self.accelerometer_mps2_per_count = self.plate.accelerometer_mps2_per_count
        self.accelerometer_count_limit = self.plate.accelerometer_count_limit

    def now_s(self):
        return self.plate.now_s()

    def play(self, samples, driven_s, rest_s):
        self.plate.play(samples, driven_s, rest_s)

    def capture(self):
        return self.plate.capture()

    def trace(self):
        return self.plate.trace()

    def stop(self):
        self.plate.stop()


if __name__ == "__main__":
    print(upm.run("arrange-4-cor", rig=MyRig("arrange-4-cor")))
