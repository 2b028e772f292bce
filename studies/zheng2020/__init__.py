"""The paper's experiments, done again with the digital twin; a module per figure.

Zheng, Sun, Wang, Faccio, "Computational 4D imaging of light-in-flight with relativistic
effects", Photonics Research 8, 1072 (2020).
"""
