"""A real browser without a window, which visits the live page as a person would."""

import shutil
from contextlib import contextmanager

from selenium import webdriver
from selenium.common.exceptions import TimeoutException
from selenium.webdriver.common.by import By
from selenium.webdriver.support.ui import WebDriverWait

FLAGS = [
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-dev-shm-usage",
    "--disable-sync",
    "--enable-unsafe-swiftshader",  # WebGL without a graphics card
    "--no-first-run",
    "--use-angle=swiftshader",
    "--use-gl=angle",
    "--window-size=960,700",
]
PATIENCE = 60  # seconds; the page draws slowly without a graphics card


@contextmanager
def browser(profile):
    """A browser with an empty profile in the folder ``profile``."""
    paths = [shutil.which(name) for name in ("chromium", "chromedriver")]
    assert all(paths), "The live page is tested in Chromium: apt-get install chromium chromium-driver"
    options = webdriver.ChromeOptions()
    options.binary_location = paths[0]
    for flag in (*FLAGS, f"--user-data-dir={profile}"):
        options.add_argument(flag)
    driver = webdriver.Chrome(options, webdriver.ChromeService(paths[1]))
    try:
        yield driver
    finally:
        driver.quit()


def text_of(driver):
    """All that the page says."""
    return driver.execute_script("return document.body.innerText")


def wait_for(driver, condition):
    """Wait until ``condition()`` is true; the error shows what the page says instead."""
    try:
        WebDriverWait(driver, PATIENCE, poll_frequency=0.2).until(lambda _: condition())
    except TimeoutException:
        raise AssertionError(f"The page says:\n{text_of(driver)}") from None


def click(driver, label):
    """Click the button that says ``label``."""
    driver.find_element(By.XPATH, f"//button[normalize-space()='{label}']").click()
